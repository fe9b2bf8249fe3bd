/* DS18B20 thermometers, each on a wire of its own with a pull-up of 4.7 kOhm to the supply. */
#ifndef THERMOMETERS_H
#define THERMOMETERS_H

#include <stdint.h>

/* From the main loop, as often as it likes: at most a millisecond between calls. */
void thermometers_serve(uint32_t now, uint32_t ticks_per_ms);

/* In 0.01 Celsius; LB_NO_SENSOR where none answers. */
int16_t thermometers_hundredths_c(uint8_t sensor);

#endif
