// C[m][n] = start(m, n) + Σ_k A[m·rs + k·cs] · B[k][n]: the one matrix product, by register tiles.
// A is read by scalars, so its transpose costs nothing; B and C have rows of whole vectors.
#pragma once
#include "simd.h"

namespace pa::PA_LEVEL {

#if defined(__AVX512F__)
inline constexpr int kTileRows = 4, kTileVectors = 5;  // 20 accumulators and 5 of B in 32 registers
#else
inline constexpr int kTileRows = 4, kTileVectors = 3;
#endif

struct FromZero {
    vf operator()(int64_t, int64_t) const { return vf{}; }
};

struct FromRows {  // row m starts from row m / share of another matrix
    const float* rows;
    int64_t stride, share;
    vf operator()(int64_t m, int64_t n) const {
        return load(rows + (uint32_t)m / (uint32_t)share * stride + n);  // 32 bits divide sooner
    }
};

struct Matrix {  // element (m, k) is at m·rs + k·cs
    const float* at;
    int64_t rs, cs;
};

template <int R, int V, class Start>
inline void tile(int64_t depth, Matrix a, const float* b, int64_t ldb, float* c, int64_t ldc,
                        int64_t m, int64_t n, const Start& start) {
    vf sum[R][V];
    for (int r = 0; r < R; r++)
        for (int v = 0; v < V; v++) sum[r][v] = start(m + r, n + v * W);
    const float* x = a.at + m * a.rs;
    b += n;
    for (int64_t k = 0; k < depth; k++, x += a.cs, b += ldb) {
        vf row[V];
        for (int v = 0; v < V; v++) row[v] = load(b + v * W);
        for (int r = 0; r < R; r++)
            for (int v = 0; v < V; v++) sum[r][v] += x[r * a.rs] * row[v];
    }
    for (int r = 0; r < R; r++)
        for (int v = 0; v < V; v++) store(c + (m + r) * ldc + n + v * W, sum[r][v]);
}

template <int V, class Start>
inline void tile_columns(int64_t rows, int64_t depth, Matrix a, const float* b, int64_t ldb,
                                float* c, int64_t ldc, int64_t n, const Start& start) {
    int64_t m = 0;
    for (; m + kTileRows <= rows; m += kTileRows)
        tile<kTileRows, V>(depth, a, b, ldb, c, ldc, m, n, start);
    if (rows - m == 3) tile<3, V>(depth, a, b, ldb, c, ldc, m, n, start);
    if (rows - m == 2) tile<2, V>(depth, a, b, ldb, c, ldc, m, n, start);
    if (rows - m == 1) tile<1, V>(depth, a, b, ldb, c, ldc, m, n, start);
}

// rows × columns, sum over depth. Columns is a multiple of kLane, B and C aligned.
template <class Start>
void multiply(int64_t rows, int64_t columns, int64_t depth, Matrix a, const float* b,
                     int64_t ldb, float* c, int64_t ldc, const Start& start) {
    int64_t n = 0;
    for (; n + kTileVectors * W <= columns; n += kTileVectors * W)
        tile_columns<kTileVectors>(rows, depth, a, b, ldb, c, ldc, n, start);
    const int64_t rest = (columns - n) / W;
    if (rest == 4) tile_columns<4>(rows, depth, a, b, ldb, c, ldc, n, start);
    if (rest == 3) tile_columns<3>(rows, depth, a, b, ldb, c, ldc, n, start);
    if (rest == 2) tile_columns<2>(rows, depth, a, b, ldb, c, ldc, n, start);
    if (rest == 1) tile_columns<1>(rows, depth, a, b, ldb, c, ldc, n, start);
}

// The same, added to what C holds.
inline void multiply_add(int64_t rows, int64_t columns, int64_t depth, Matrix a, const float* b,
                         int64_t ldb, float* c, int64_t ldc) {
    multiply(rows, columns, depth, a, b, ldb, c, ldc, FromRows{c, ldc, 1});
}

// out[n][m] = in[m][n], by squares of 4 × 4; rows and columns are multiples of kLane.
inline void transpose(const float* in, int64_t rows, int64_t columns, float* out) {
    typedef float v4 __attribute__((vector_size(16), may_alias));
    typedef int32_t i4 __attribute__((vector_size(16)));
    const i4 low = {0, 4, 1, 5}, high = {2, 6, 3, 7}, first = {0, 1, 4, 5}, last = {2, 3, 6, 7};
    const auto at = [](auto* p, int64_t line, int64_t stride) -> v4& {
        return *(v4*)(p + line * stride);
    };
    for (int64_t n = 0; n < columns; n += 4)
        for (int64_t m = 0; m < rows; m += 4) {
            const float* from = in + m * columns + n;
            float* to = out + n * rows + m;
            const v4 a = at(from, 0, columns), b = at(from, 1, columns);
            const v4 c = at(from, 2, columns), d = at(from, 3, columns);
            const v4 ab0 = __builtin_shuffle(a, b, low), ab1 = __builtin_shuffle(a, b, high);
            const v4 cd0 = __builtin_shuffle(c, d, low), cd1 = __builtin_shuffle(c, d, high);
            at(to, 0, rows) = __builtin_shuffle(ab0, cd0, first);
            at(to, 1, rows) = __builtin_shuffle(ab0, cd0, last);
            at(to, 2, rows) = __builtin_shuffle(ab1, cd1, first);
            at(to, 3, rows) = __builtin_shuffle(ab1, cd1, last);
        }
}

}  // namespace pa::PA_LEVEL
