#define _POSIX_C_SOURCE 200809L

#include "commands.h"

#include <string.h>
#include <unistd.h>

#define TEXT_BYTES 256U

bool commands_obey(bool (*execute)(const char *text, const void *context), const void *context)
{
    static char text[TEXT_BYTES];
    static size_t length;
    const ssize_t n_read = read(STDIN_FILENO, &text[length], sizeof text - 1U - length);
    if (n_read <= 0) {
        return false;
    }
    length += (size_t)n_read;
    text[length] = '\0';
    char *begin = text;
    for (char *end = strchr(begin, '\n'); end != NULL; end = strchr(begin, '\n')) {
        *end = '\0';
        if (!execute(begin, context)) {
            return false;
        }
        begin = &end[1];
    }
    length -= (size_t)(begin - text);
    memmove(text, begin, length);
    return length < sizeof text - 1U;
}
