#define _XOPEN_SOURCE 700

#include "line.h"

#include <fcntl.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>
#include <termios.h>
#include <unistd.h>

#include "message.h"

#define BUFFER_BYTES 65000U
#define CAUSE_TIMED_FRAME 0x02U /* first byte of a timed sample's frame: the cause 0 is next */

static struct {
    int master; /* -1: unplugged */
    bool is_open; /* the host has its end open */
    bool host_gone;
    size_t n_waiting;
    uint8_t waiting[BUFFER_BYTES];
    uint32_t n_to_lose;
    uint8_t type_to_spoil; /* 0: none */
} line = {.master = -1};

bool line_plug(const char *link)
{
    const int master = posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK);
    if (master < 0) {
        return false;
    }
    const char *name = NULL;
    int slave = -1;
    struct termios mode;
    if (grantpt(master) == 0 && unlockpt(master) == 0) {
        name = ptsname(master);
    }
    if (name != NULL) {
        slave = open(name, O_RDWR | O_NOCTTY);
    }
    bool is_made = false;
    if (slave >= 0 && tcgetattr(slave, &mode) == 0) {
        /* Raw: bytes pass as they are, nothing is echoed. */
        mode.c_iflag = 0;
        mode.c_oflag = 0;
        mode.c_lflag = 0;
        mode.c_cflag = CS8 | CREAD | CLOCAL;
        (void)unlink(link);
        is_made = tcsetattr(slave, TCSANOW, &mode) == 0 && symlink(name, link) == 0;
    }
    if (slave >= 0) {
        /* From now on POLLHUP says that nobody has the other end open. */
        (void)close(slave);
    }
    if (!is_made) {
        (void)close(master);
        return false;
    }
    line.master = master;
    line.is_open = false;
    line.n_waiting = 0U;
    return true;
}

void line_unplug(const char *link)
{
    if (line.master >= 0) {
        (void)unlink(link);
        (void)close(line.master);
        line.master = -1;
        line.host_gone = line.host_gone || line.is_open;
        line.is_open = false;
        line.n_waiting = 0U;
    }
}

int line_descriptor(void)
{
    struct pollfd state = {.fd = line.master, .events = POLLIN};
    if (line.master < 0 || poll(&state, 1, 0) < 0) {
        return -1;
    }
    const bool is_open = ((unsigned)state.revents & (unsigned)POLLHUP) == 0U;
    if (line.is_open && !is_open) {
        line.host_gone = true;
        line.n_waiting = 0U;
    }
    line.is_open = is_open;
    return is_open ? line.master : -1;
}

bool line_host_gone(void)
{
    const bool gone = line.host_gone;
    line.host_gone = false;
    return gone;
}

size_t line_read(uint8_t *bytes, size_t n_bytes)
{
    const ssize_t n_read = line.master >= 0 ? read(line.master, bytes, n_bytes) : -1;
    return n_read > 0 ? (size_t)n_read : 0U;
}

void line_flush(void)
{
    if (line.master >= 0 && line.n_waiting > 0U) {
        const ssize_t n_written = write(line.master, line.waiting, line.n_waiting);
        if (n_written > 0) {
            line.n_waiting -= (size_t)n_written;
            memmove(line.waiting, &line.waiting[n_written], line.n_waiting);
        }
    }
}

uint16_t line_room(void)
{
    return (uint16_t)(BUFFER_BYTES - line.n_waiting);
}

void line_send(const uint8_t *bytes, uint16_t n_bytes)
{
    if (!line.is_open) {
        return; /* as a UART without a cable */
    }
    if (line.n_to_lose > 0U && bytes[0] == CAUSE_TIMED_FRAME && bytes[1] == LB_SAMPLE_TYPE) {
        line.n_to_lose--;
        return;
    }
    uint8_t *to = &line.waiting[line.n_waiting];
    memcpy(to, bytes, n_bytes);
    if (line.type_to_spoil != 0U && bytes[1] == line.type_to_spoil) {
        line.type_to_spoil = 0U;
        to[1] ^= 0x10U; /* no frame has a type of which this bit makes a zero */
    }
    line.n_waiting += n_bytes;
}

void line_lose(uint32_t n_samples)
{
    line.n_to_lose = n_samples;
}

void line_spoil(uint8_t type)
{
    line.type_to_spoil = type;
}
