// Canonical networks: the flattened Ω and MLPs (paper, appendix; pa_ros/networks/canonical.py).
// h = W1 tanh(W0 x + b0) is what the programmable trunk's h is to the same heads. K programs on one
// transition share the scene's part of W0 x; the target's is a row of W0 for each of its words.
#pragma once
#include "gemm.h"
#include "work.h"

namespace pa::PA_LEVEL {

// x: the hand's features, then a slot for each kind, then the arm's. Rows of w.x.
inline void flatten(const Net& net, Work& w, const float* objects, const float* arm, int64_t from,
                    int count) {
    const Network& n = *net.shape;
    const int64_t stride = padded(net.l.inputs), features = n.object_features;
    float scaled[kMaxFeatures];
    const auto add = [&](float* out) {
        for (int f = 0; f < features; f++) out[f] += scaled[f];
    };
    __builtin_memset(w.x, 0, count * stride * sizeof(float));
    for (int64_t s = 0; s < count; s++) {
        float* out = w.x + s * stride;
        for (int i = 0; i < w.objects; i++) {
            const float* in = objects + ((from + s) * w.objects + i) * features;
            for (int f = 0; f < features; f++) scaled[f] = in[f] * n.scale[f];
            if (i == w.hand_index) add(out);
            for (int slot = 0; slot < n.slots; slot++) {
                bool fills = true;
                for (int g = 0; fills && g < n.groups; g++)
                    fills = shows(n, n.slot_word[slot][g], scaled);
                if (fills) add(out + (1 + slot) * features);
            }
        }
        out += (1 + n.slots) * features;
        for (int f = 0; f < n.arm_features; f++) out[f] = arm[(from + s) * n.arm_features + f];
    }
}

// h of every sample and program of the chunk, from w.x; leaves the first layer's tanh in w.first.
inline void mlp_forward(const Net& net, Work& w, const int32_t* programs, int count) {
    const Layout& l = net.l;
    const int64_t h = l.hidden, pairs = (int64_t)count * w.programs;
    const int groups = net.shape->groups;
    const float *first = net.p + l.first, *words = first + l.inputs * h;
    const float* bias = words + net.shape->words * h;
    multiply(count, h, l.inputs, {w.x, padded(l.inputs), 1}, first, h, w.first_arm, h,
             FromRows{bias, 0, 1});
    for (int64_t sk = 0; sk < pairs; sk++) {
        const int32_t* target = w.words + (int64_t)programs[sk] * groups;
        const float* scene = w.first_arm + sk / w.programs * h;
        for (int64_t c = 0; c < h; c += W) {
            vf x = load(scene + c);
            for (int g = 0; g < groups; g++) x += load(words + target[g] * h + c);
            store(w.first + sk * h + c, tanh_of(x));
        }
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
    const int groups = net.shape->groups;
    float *first = gradient + l.first, *words = first + l.inputs * h;
    float *bias = words + net.shape->words * h, *second_bias = gradient + l.second_bias;
    const auto add = [](float* to, vf x) { store(to, load(to) + x); };
    multiply(pairs, h, size, {w.dh, h, 1}, second_t, h, w.dpooled, h, FromZero{});
    multiply_add(size, h, pairs, {w.first, 1, h}, w.dh, h, gradient + l.second, h);
    __builtin_memset(w.first_arm, 0, count * h * sizeof(float));
    for (int64_t sk = 0; sk < pairs; sk++) {
        const int32_t* target = w.words + (int64_t)programs[sk] * groups;
        float* scene = w.first_arm + sk / w.programs * h;
        for (int64_t c = 0; c < h; c += W) {
            const vf z = load(w.first + sk * h + c);
            const vf d = load(w.dpooled + sk * h + c) * (1.0f - z * z);
            add(scene + c, d), add(bias + c, d);
            for (int g = 0; g < groups; g++) add(words + target[g] * h + c, d);
            if (!net.shape->critic) add(second_bias + c, load(w.dh + sk * h + c));
        }
    }
    multiply_add(l.inputs, h, count, {w.x, 1, padded(l.inputs)}, w.first_arm, h, first, h);
}

}  // namespace pa::PA_LEVEL
