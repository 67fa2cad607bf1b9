// Vectors of the widest kind the instruction set has, and the functions of them we need.
#pragma once
#include <cstdint>
#if defined(__AVX512F__)
#include <immintrin.h>
#endif

#include "level.h"

namespace pa::PA_LEVEL {

#if defined(__AVX512F__)
inline constexpr int W = 16;
#elif defined(__AVX2__)
inline constexpr int W = 8;
#else
inline constexpr int W = 4;
#endif

typedef float vf __attribute__((vector_size(4 * W), may_alias));
typedef float vfu __attribute__((vector_size(4 * W), may_alias, aligned(4)));
typedef int32_t vi __attribute__((vector_size(4 * W), may_alias));

inline vf load(const float* p) { return *reinterpret_cast<const vf*>(p); }
inline vf loadu(const float* p) { return *reinterpret_cast<const vfu*>(p); }
inline void store(float* p, vf x) { *reinterpret_cast<vf*>(p) = x; }
inline void storeu(float* p, vf x) { *reinterpret_cast<vfu*>(p) = x; }
inline vf splat(float x) { return vf{} + x; }

// min and max of a vector and a bound; NaN stays NaN.
inline vf at_most(vf x, float bound) {
#if defined(__AVX512F__)
    return _mm512_min_ps(splat(bound), x);
#else
    return x > bound ? splat(bound) : x;
#endif
}

inline vf at_least(vf x, float bound) {
#if defined(__AVX512F__)
    return _mm512_max_ps(splat(bound), x);
#else
    return x < bound ? splat(bound) : x;
#endif
}

inline vf square_root(vf x) {
#if defined(__AVX512F__)
    return _mm512_sqrt_ps(x);
#else
    for (int i = 0; i < W; i++) x[i] = __builtin_sqrtf(x[i]);
    return x;
#endif
}

// 1/x to within 1.5 units in the last place; x in [0.5, 2^100].
inline vf reciprocal(vf x) {
#if defined(__AVX512F__)
    const vf guess = _mm512_rcp14_ps(x);  // 2^-14, doubled by one Newton step
    return guess * (2.0f - x * guess);
#else
    return 1.0f / x;
#endif
}

// 2^x for |x| <= 126 (clamped); relative error 2e-7, by a minimax polynomial on [-1/2, 1/2].
inline vf exp2_clamped(vf x) {
    x = at_least(at_most(x, 126.0f), -126.0f);
#if defined(__AVX512F__)
    const vf n = _mm512_roundscale_ps(x, 0);
#else
    const vf magic = splat(12582912.0f);  // 1.5 × 2^23 rounds to the nearest integer
    const vf n = (x + magic) - magic;
#endif
    const vf f = x - n;
    vf y = splat(1.534581242594868e-4f);
    y = y * f + 1.3399930903688073e-3f;
    y = y * f + 9.618489071726799e-3f;
    y = y * f + 5.550328642129898e-2f;
    y = y * f + 2.4022646248340607e-1f;
    y = y * f + 6.931471824645996e-1f;
    y = y * f + 1.0f;
#if defined(__AVX512F__)
    return _mm512_scalef_ps(y, n);
#else
    const vi exponent = (__builtin_convertvector(n, vi) + 127) << 23;
    return y * reinterpret_cast<const vf&>(exponent);
#endif
}

inline constexpr float kLog2E = 1.4426950408889634f;

inline vf exponential(vf x) { return exp2_clamped(x * kLog2E); }

// tanh(x) = 1 - 1/h with h = (1 + e^2x)/2: absolute error 2e-7, exact in sign and limits.
// A sum is the point: e^2(x+y) = e^2x · e^2y, so N² sums cost 2N exponentials. The price: each of
// x and y is clamped to ±43.6, where floats end.
inline vf exponential_of_twice(vf x) { return exp2_clamped(x * (2.0f * kLog2E)); }
inline vf tanh_of_sum(vf half_exp_2x, vf exp_2y) {
    return 1.0f - reciprocal(at_most(half_exp_2x * exp_2y + 0.5f, 0x1p100f));
}
inline vf tanh_of(vf x) { return 1.0f - reciprocal(0.5f * exponential_of_twice(x) + 0.5f); }

// Sums of the lanes of n vectors. `out` has room for n rounded up to a multiple of W.
inline void sum_lanes(const vf* x, int64_t n, float* out) {
#if defined(__AVX512F__)
    for (int64_t base = 0; base < n; base += 16) {
        vf a[16];
        for (int i = 0; i < 16; i++) a[i] = base + i < n ? x[base + i] : vf{};
        for (int i = 0; i < 8; i++)
            a[i] = (vf)_mm512_unpacklo_ps(a[2 * i], a[2 * i + 1]) +
                   (vf)_mm512_unpackhi_ps(a[2 * i], a[2 * i + 1]);
        for (int i = 0; i < 4; i++) {
            const __m512d p = (__m512d)a[2 * i], q = (__m512d)a[2 * i + 1];
            a[i] = (vf)_mm512_unpacklo_pd(p, q) + (vf)_mm512_unpackhi_pd(p, q);
        }
        for (int k = 2; k >= 1; k--)
            for (int i = 0; i < k; i++)
                a[i] = (vf)_mm512_shuffle_f32x4(a[2 * i], a[2 * i + 1], 0x88) +
                       (vf)_mm512_shuffle_f32x4(a[2 * i], a[2 * i + 1], 0xdd);
        *reinterpret_cast<vfu*>(out + base) = a[0];
    }
#else
    for (int64_t i = 0; i < n; i++) {
        float lane[W];
        __builtin_memcpy(lane, x + i, sizeof lane);
        for (int k = W / 2; k >= 1; k /= 2)
            for (int j = 0; j < k; j++) lane[j] += lane[j + k];
        out[i] = lane[0];
    }
#endif
}

}  // namespace pa::PA_LEVEL
