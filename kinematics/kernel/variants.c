/* The same source for several sets of instructions, and which of them run here. */
#include "arm.h"
#include "effects.h"

#include <float.h>
#include <math.h>
#include <stdint.h>
#include <string.h>

#if FLT_EVAL_METHOD != 0
#error "doubles are computed in more than 64 bits: NumPy runs instead of the kernel"
#endif

#define JOINED(a, b) a##_##b
#define NAMED(a, b) JOINED(a, b)
#define OF(name) NAMED(name, VARIANT)

#define VARIANT portable
#include "variant.inc"
#undef VARIANT

#if defined(__x86_64__) && (defined(__GNUC__) || defined(__clang__))
#define HAS_X86 1

#ifdef __clang__
#pragma clang attribute push(__attribute__((target("avx2"))), apply_to = function)
#else
#pragma GCC push_options
#pragma GCC target("avx2")
#endif
#define BLENDS
#define VARIANT avx2
#include "variant.inc"
#undef VARIANT
#ifdef __clang__
#pragma clang attribute pop
#pragma clang attribute push(                                                          \
    __attribute__((target("avx512f,avx512dq,avx512vl,avx512bw"))), apply_to = function)
#else
#pragma GCC pop_options
#pragma GCC push_options
#pragma GCC target("avx512f,avx512dq,avx512vl,avx512bw,prefer-vector-width=512")
#endif
#define VARIANT avx512
#include "variant.inc"
#undef VARIANT
#ifdef __clang__
#pragma clang attribute pop
#else
#pragma GCC pop_options
#endif
#endif

const variant_t *variant_at(int which)
{
    switch (which) {
    case 0:
        return &variant_portable;
#ifdef HAS_X86
    case 1:
        return &variant_avx2;
    case 2:
        return &variant_avx512;
#endif
    default:
        return NULL;
    }
}

int variant_runs(int which)
{
#ifdef HAS_X86
    __builtin_cpu_init();
    if (which == 1)
        return __builtin_cpu_supports("avx2") != 0;
    if (which == 2)
        return __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq")
            && __builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512bw");
#endif
    return which == 0;
}
