/* Poses and derivatives of the portable variant, for a processor that Python does not
 * run on here: an arm and readings from standard input, results to standard output.
 *
 *     n_joints, n_samples (int64); zeros, axes, links with the probe vector, origin,
 *     direction; readings (n_samples, n_joints), all float64
 */
#include "arm.h"

#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

static void take(void *to, size_t size, size_t n)
{
    if (fread(to, size, n, stdin) != n)
        exit(1);
}

static double *room(size_t n)
{
    double *found = calloc(n, sizeof(double));
    if (!found)
        exit(2);
    return found;
}

static void give(const double *from, size_t n)
{
    if (fwrite(from, sizeof(double), n, stdout) != n)
        exit(3);
}

int main(void)
{
    int64_t head[2];
    take(head, sizeof *head, 2);
    const size_t n = (size_t)head[0], rows = (size_t)head[1];
    arm_t arm = {.n_joints = (int)n};
    take(arm.zeros_rad, sizeof(double), n);
    take(arm.axes, sizeof(double), 3 * n);
    take(arm.links_mm, sizeof(double), 3 * n);
    take(arm.origin_mm, sizeof(double), 3);
    take(arm.direction, sizeof(double), 3);
    double *angles = room(rows * n), *centres = room(3 * rows);
    double *directions = room(3 * rows), *one = room(6);
    take(angles, sizeof(double), rows * n);
    derivatives_t out = {room(3 * rows), room(3 * n * rows), room(9 * n * rows),
                         room(9 * n * rows)};
    const variant_t *code = variant_at(0);
    const table_t source = {(char *)angles, (ptrdiff_t)(8 * n), 8};
    const table_t to_centres = {(char *)centres, 24, 8};
    const table_t to_directions = {(char *)directions, 24, 8};
    code->poses(&arm, source, (ptrdiff_t)rows, to_centres, to_directions);
    code->derivatives(&arm, source, (ptrdiff_t)rows, out);
    code->pose(&arm, angles, one, one + 3);
    give(centres, 3 * rows);
    give(directions, 3 * rows);
    give(out.by_angles, 3 * n * rows);
    give(out.by_axes, 9 * n * rows);
    give(out.by_links, 9 * n * rows);
    give(one, 6);
    return 0;
}
