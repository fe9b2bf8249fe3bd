/* Models of DS18B20 thermometers on PF0 onwards, from their data sheet. */
#ifndef MODEL_THERMOMETERS_H
#define MODEL_THERMOMETERS_H

#include <stdint.h>

#define THERMOMETER_WIRES 4U
#define THERMOMETER_ABSENT (-32768)

void thermometers_init(void);
/* Continue after the power was off. */
void thermometers_restart(void);
void thermometers_set(unsigned wire, int hundredths_c);

#endif
