// Canonical networks: the flattened Ω and MLPs (paper, appendix; pa_ros/networks/canonical.py).
// h = W1 tanh(W0 x + b0) is what the programmable trunk's h is to the same heads. K programs on one
// transition share the scene's part of W0 x; the target's is two rows of W0, one for each word.
#pragma once
#include "gemm.h"
#include "work.h"

namespace pa::PA_LEVEL {

// x: the hand's features, then a slot for each (shape, color), then the arm's. Rows of w.x.
inline void flatten(const Net& net, Work& w, const float* objects, const float* arm, int64_t from,
                    int count) {
    const Network& n = *net.shape;
    const int64_t stride = padded(net.l.inputs);
    const auto add = [&](float* out, const float* in, float weight) {
        for (int f = 0; f < kObjectFeatures; f++)
            out[f] += weight * (f < 3 ? in[f] * n.position_scale : in[f]);
    };
    __builtin_memset(w.x, 0, count * stride * sizeof(float));
    for (int64_t s = 0; s < count; s++) {
        float* out = w.x + s * stride;
        const float* scene = objects + (from + s) * w.objects * kObjectFeatures;
        add(out, scene + w.hand_index * kObjectFeatures, 1.0f);
        for (int i = 0; i < w.objects; i++)
            for (int slot = 0; slot < n.slots; slot++) {
                const float* in = scene + i * kObjectFeatures;
                const float fills = in[n.slot_shape[slot]] * in[n.slot_color[slot]];
                if (fills != 0.0f) add(out + (1 + slot) * kObjectFeatures, in, fills);
            }
        out += (1 + n.slots) * kObjectFeatures;
        for (int f = 0; f < kArmFeatures; f++) out[f] = arm[(from + s) * kArmFeatures + f];
    }
}

// h of every sample and program of the chunk, from w.x; leaves the first layer's tanh in w.first.
inline void mlp_forward(const Net& net, Work& w, const int32_t* programs, int count) {
    const Layout& l = net.l;
    const int64_t h = l.hidden, pairs = (int64_t)count * w.programs;
    const float *first = net.p + l.first, *words = first + l.inputs * h;
    const float* bias = words + net.shape->words * h;
    multiply(count, h, l.inputs, {w.x, padded(l.inputs), 1}, first, h, w.first_arm, h,
             FromRows{bias, 0, 1});
    for (int64_t sk = 0; sk < pairs; sk++) {
        const int32_t* target = w.target + (int64_t)programs[sk] * kTargetWords;
        const float *scene = w.first_arm + sk / w.programs * h, *a = words + target[0] * h;
        const float* b = words + target[1] * h;
        for (int64_t c = 0; c < h; c += W)
            store(w.first + sk * h + c, tanh_of(load(scene + c) + load(a + c) + load(b + c)));
    }
    multiply(pairs, h, net.shape->hidden, {w.first, h, 1}, net.p + l.second, h, w.h, h,
             FromRows{net.p + l.second_bias, 0, 1});
}

// Adds the gradients of both hidden layers, given w.dh. `second_t` is `second` transposed. The
// critic's second bias is the action layer's, so it has none here.
inline void mlp_backward(const Net& net, Work& w, const int32_t* programs, int count,
                         const float* second_t, float* gradient) {
    const Layout& l = net.l;
    const int64_t h = l.hidden, size = net.shape->hidden, pairs = (int64_t)count * w.programs;
    float *first = gradient + l.first, *words = first + l.inputs * h;
    float *bias = words + net.shape->words * h, *second_bias = gradient + l.second_bias;
    const auto add = [](float* to, vf x) { store(to, load(to) + x); };
    multiply(pairs, h, size, {w.dh, h, 1}, second_t, h, w.dpooled, h, FromZero{});
    multiply_add(size, h, pairs, {w.first, 1, h}, w.dh, h, gradient + l.second, h);
    __builtin_memset(w.first_arm, 0, count * h * sizeof(float));
    for (int64_t sk = 0; sk < pairs; sk++) {
        const int32_t* target = w.target + (int64_t)programs[sk] * kTargetWords;
        float *scene = w.first_arm + sk / w.programs * h, *a = words + target[0] * h;
        float* b = words + target[1] * h;
        for (int64_t c = 0; c < h; c += W) {
            const vf z = load(w.first + sk * h + c);
            const vf d = load(w.dpooled + sk * h + c) * (1.0f - z * z);
            add(scene + c, d), add(a + c, d), add(b + c, d), add(bias + c, d);
            if (!net.shape->critic) add(second_bias + c, load(w.dh + sk * h + c));
        }
    }
    multiply_add(l.inputs, h, count, {w.x, 1, padded(l.inputs)}, w.first_arm, h, first, h);
}

}  // namespace pa::PA_LEVEL
