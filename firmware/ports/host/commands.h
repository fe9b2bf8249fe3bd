/* Commands on standard input, one a line. */
#ifndef COMMANDS_H
#define COMMANDS_H

#include <stdbool.h>

/* Read commands and execute whole lines; false when they have ended. */
bool commands_obey(bool (*execute)(const char *text, const void *context), const void *context);

#endif
