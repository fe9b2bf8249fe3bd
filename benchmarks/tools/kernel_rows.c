/* Centres of so many poses of an arm of seven joints, by the portable variant: what is
 * counted by benchmarks/kernel_instructions.py. Prints their sum.
 */
#include "effects.h"

#include <stdio.h>
#include <stdlib.h>

enum { JOINTS = 7 };

int main(int argc, char **argv)
{
    const int rows = argc > 1 ? atoi(argv[1]) : 0;
    static arm_t arm = {.n_joints = JOINTS, .direction = {0.0, 0.0, 1.0}};
    for (int k = 0; k < JOINTS; k++) {
        arm.zeros_rad[k] = 0.1 * k;
        arm.axes[k][k % 3] = 0.6;
        arm.axes[k][(k + 1) % 3] = 0.48;
        arm.axes[k][(k + 2) % 3] = 0.64;
        for (int c = 0; c < 3; c++)
            arm.links_mm[k][c] = 10.0 * k + c;
    }
    double *angles = malloc(sizeof(double) * JOINTS * (size_t)rows);
    double *centres = malloc(sizeof(double) * 3 * (size_t)rows);
    if (!angles || !centres)
        return 1;
    for (int i = 0; i < JOINTS * rows; i++)
        angles[i] = 1e-3 * (i % 6000) - 3.0;
    const table_t from = {(char *)angles, 8 * JOINTS, 8};
    const table_t to = {(char *)centres, 24, 8}, nowhere = {0};
    variant_at(0)->poses(&arm, from, rows, to, nowhere);
    double sum = 0.0;
    for (int i = 0; i < 3 * rows; i++)
        sum += centres[i];
    printf("%.17g\n", sum);
    return 0;
}
