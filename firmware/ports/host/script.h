/* Commands that a test gives to the machine, one a line. */
#ifndef SCRIPT_H
#define SCRIPT_H

#include <stdbool.h>

#include "machine.h"

/* Execute a line; prints `done`, what was asked for, or `error: ...`. False: it ends. */
bool script_execute(const char *text, const struct machine_options *options, const char *link);

#endif
