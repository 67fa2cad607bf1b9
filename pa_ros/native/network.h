// A network of either kind, the programmable trunk or canonical: inputs, h, and the way back.
#pragma once
#include "mlp.h"
#include "trunk_backward.h"

namespace pa::PA_LEVEL {

// Copies inputs of samples [from, from + count) and scales the positions.
inline void read_inputs(const Net& net, Work& w, const float* objects, const float* arm,
                        int64_t from, int count) {
    if (net.shape->canonical) return flatten(net, w, objects, arm, from, count);
    const float position_scale = net.shape->position_scale;
    const int64_t rows = (int64_t)count * w.objects;
    const float* in = objects + from * w.objects * kObjectFeatures;
    for (int64_t r = 0; r < rows * kObjectFeatures; r += kObjectFeatures)
        for (int f = 0; f < kObjectFeatures; f++)
            w.x[r + f] = f < 3 ? in[r + f] * position_scale : in[r + f];
    for (int64_t s = 0; s < count; s++) {
        float* out = w.arm + s * kArmColumns;
        for (int f = 0; f < kArmFeatures; f++) out[f] = arm[(from + s) * kArmFeatures + f];
        out[kArmFeatures] = 1.0f, out[kArmFeatures + 1] = 0.0f;
    }
}

// h of every sample and program of the chunk, from what `read_inputs` left. `programs` is
// [count, K]. `keep`: leave the activations of the whole chunk, for `backward`.
inline void forward(const Net& net, Work& w, const int32_t* programs, int count, bool keep) {
    if (net.shape->canonical) return mlp_forward(net, w, programs, count);
    trunk_forward(net, w, programs, count, keep);
}

// Adds the gradients of all before h, given w.dh. `second_t` is `second` transposed.
inline void backward(const Net& net, Work& w, const int32_t* programs, int count,
                     const float* second_t, float* gradient) {
    if (net.shape->canonical) return mlp_backward(net, w, programs, count, second_t, gradient);
    trunk_backward(net, w, programs, count, second_t, gradient);
}

}  // namespace pa::PA_LEVEL
