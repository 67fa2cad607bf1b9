// A network of either kind, the programmable trunk or canonical: inputs, h, and the way back.
#pragma once
#include "mlp.h"
#include "trunk_backward.h"

namespace pa::PA_LEVEL {

// Copies inputs of samples [from, from + count) and scales the objects' features.
inline void read_inputs(const Net& net, Work& w, const float* objects, const float* arm,
                        int64_t from, int count) {
    if (net.shape->canonical) return flatten(net, w, objects, arm, from, count);
    const int features = net.shape->object_features, arms = net.shape->arm_features;
    const int64_t size = (int64_t)count * w.objects * features;
    const float *in = objects + from * w.objects * features, *scale = net.shape->scale;
    for (int64_t r = 0; r < size; r += features)
        for (int f = 0; f < features; f++) w.x[r + f] = in[r + f] * scale[f];
    for (int64_t s = 0; s < count; s++) {
        float* out = w.arm + s * (arms + 1);
        for (int f = 0; f < arms; f++) out[f] = arm[(from + s) * arms + f];
        out[arms] = 1.0f;
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
