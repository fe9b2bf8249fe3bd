/* Poses, deflected poses and derivatives of the portable variant, for a processor that Python does not
 * run on here: an arm and readings from standard input, results to standard output.
 *
 *     n_joints, n_samples (int64); zeros, axes, links with the probe vector, origin,
 *     direction; readings (n_samples, n_joints), all float64
 */
#include "effects.h"

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
    double *doubles = calloc(n, sizeof(double));
    if (!doubles)
        exit(2);
    return doubles;
}

static void give(const double *from, size_t n)
{
    if (fwrite(from, sizeof(double), n, stdout) != n)
        exit(3);
}

/* One effect of each form that computes more than a sum, of the sizes that the test
 * gives them too; the links are the levers.
 */
static void deflect(const variant_t *code, const arm_t *arm, table_t source,
                    ptrdiff_t rows, table_t centres, table_t directions)
{
    const term_t terms[] = {
        {.form = READING_WAVE, .joint = 1, .order = 3, .values = {1e-4, -2e-4}},
        {.form = TURN_MOMENT, .joint = 0, .values = {1e-7}},
        {.form = TILT_MOMENT, .joint = 1, .values = {1e-7}},
        {.form = MOUNT_MOMENT, .values = {1e-7}},
        {.form = SHIFT_WAVE, .joint = 1, .order = 1, .values = {0.1, 0, 0, 0, 0.2, 0}},
        {.form = TILT_WAVE, .order = 2, .values = {1e-4, 0, 0, 0, 2e-4, 0}},
    };
    effects_t effects = {.n_terms = 6, .terms = terms, .weighs = 1, .moves_mount = 1};
    effects.moves[0] = MOVES_TURN | MOVES_TILT;
    effects.moves[1] = MOVES_READING | MOVES_TILT | MOVES_SHIFT;
    for (int k = 0; k < arm->n_joints; k++)
        for (int c = 0; c < 3; c++)
            effects.element_mm[k][c] = effects.levers_kg_m[k][c] = arm->links_mm[k][c];
    samples_t samples = {.angles_rad = source, .gravity_m_s2 = {0.5, 1.0, -9.5}};
    code->deflected(arm, &effects, &samples, rows, centres, directions);
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
    double *directions = room(3 * rows), *single = room(6);
    take(angles, sizeof(double), rows * n);
    derivatives_t out = {room(3 * rows), room(3 * n * rows), room(9 * n * rows),
                         room(9 * n * rows)};
    const variant_t *code = variant_at(0);
    const table_t source = {(char *)angles, (ptrdiff_t)(8 * n), 8};
    const table_t to_centres = {(char *)centres, 24, 8};
    const table_t to_directions = {(char *)directions, 24, 8};
    code->poses(&arm, source, (ptrdiff_t)rows, to_centres, to_directions);
    code->derivatives(&arm, source, (ptrdiff_t)rows, out);
    code->pose(&arm, angles, single, single + 3);
    give(centres, 3 * rows);
    give(directions, 3 * rows);
    give(out.by_angles, 3 * n * rows);
    give(out.by_axes, 9 * n * rows);
    give(out.by_links, 9 * n * rows);
    give(single, 6);
    deflect(code, &arm, source, (ptrdiff_t)rows, to_centres, to_directions);
    give(centres, 3 * rows);
    give(directions, 3 * rows);
    return 0;
}
