// Layers between h and the output, each z' = tanh(U z + b). Rows are samples × programs.
#pragma once
#include "gemm.h"
#include "work.h"

namespace pa::PA_LEVEL {

// What upper layer `layer` writes, in `upper`; layer -1 is their input.
inline float* lifted(const Work& w, float* z, float* upper, int layer, int64_t size) {
    return layer < 0 ? z : upper + layer * (int64_t)w.samples * w.programs * size;
}

// The input of the output layer: w.z, or the last of the upper layers.
inline float* top(const Net& net, const Work& w) {
    return lifted(w, w.z, w.upper, net.shape->upper - 1, net.l.hidden);
}

// From w.z through the upper layers into w.upper.
inline void lift(const Net& net, Work& w, int64_t rows) {
    const int64_t h = net.l.hidden;
    for (int layer = 0; layer < net.shape->upper; layer++) {
        const float* weight = net.p + net.l.upper + layer * (h + 1) * h;
        const float* in = lifted(w, w.z, w.upper, layer - 1, h);
        float* out = lifted(w, w.z, w.upper, layer, h);
        multiply(rows, h, net.shape->hidden, {in, h, 1}, weight, h, out, h,
                 FromRows{weight + h * h, 0, 1});
        for (int64_t c = 0; c < rows * h; c += W) store(out + c, tanh_of(load(out + c)));
    }
}

// `d` is ∂/∂ the sums under the last tanh, and becomes that of the sums under w.z's. `transposed`
// holds the layers' weights transposed; `gradient` null: of no parameters.
inline void sink(const Net& net, Work& w, int64_t rows, const float* transposed, float* d,
                 float* gradient) {
    const int64_t h = net.l.hidden, size = net.shape->hidden;
    for (int layer = net.shape->upper - 1; layer >= 0; layer--) {
        const float* in = lifted(w, w.z, w.upper, layer - 1, h);
        if (gradient) {
            float* out = gradient + net.l.upper + layer * (h + 1) * h;
            multiply_add(size, h, rows, {in, 1, h}, d, h, out, h);
            float* bias = out + h * h;
            for (int64_t r = 0; r < rows; r++)
                for (int64_t c = 0; c < h; c += W)
                    store(bias + c, load(bias + c) + load(d + r * h + c));
        }
        multiply(rows, h, size, {d, h, 1}, transposed + layer * h * h, h, w.dlift_before, h,
                 FromZero{});
        for (int64_t c = 0; c < rows * h; c += W) {
            const vf z = load(in + c);
            store(d + c, load(w.dlift_before + c) * (1.0f - z * z));
        }
    }
}

inline void transpose_upper(const Net& net, float* out) {
    const int64_t h = net.l.hidden;
    for (int layer = 0; layer < net.shape->upper; layer++)
        transpose(net.p + net.l.upper + layer * (h + 1) * h, h, h, out + layer * h * h);
}

}  // namespace pa::PA_LEVEL
