// What programs avoid (docs/DESIGN.md, "Avoiding"): h has a share of each object to be avoided.
#pragma once
#include "program.h"

namespace pa::PA_LEVEL {

// p_avoid of a program that has run, in w.avoided; 0 for the hand.
inline void assign_avoided(const Net& net, Work& w, int64_t s, int64_t sk, int64_t program) {
    const float* degree = register_at(w, net.shape->words, s, sk, w.sets[kAvoided][program]);
    float* out = w.avoided + sk * w.lanes;
    for (int i = 0; i < w.lanes; i++)
        out[i] = i < w.objects && i != w.hand_index ? degree[i] : 0.0f;
}

// Σ p_avoid_i tanh(a0_i) of all K programs of a sample: the third part of w.pooled.
inline void pool_avoided(const Net& net, Work& w, int64_t s) {
    const Layout& l = net.l;
    const float* first = w.first_of(s, l.columns) + l.avoid;
    for (int64_t sk = s * w.programs; sk < (s + 1) * w.programs; sk++) {
        const float* avoided = w.avoided + sk * w.lanes;
        float* out = w.pooled + (sk * l.parts + 2) * l.hidden;
        for (int64_t c = 0; c < l.hidden; c += W) {
            vf sum{};
            for (int i = 0; i < w.objects; i++) sum += avoided[i] * load(first + i * l.columns + c);
            store(out + c, sum);
        }
    }
}

// Gradients of avoid.0 before tanh, in place of its activations, and ∂/∂p_avoid in w.davoided.
inline void pool_avoided_backward(const Net& net, Work& w, int64_t s) {
    const Layout& l = net.l;
    const int n = w.objects;
    float* first = w.first_of(s, l.columns) + l.avoid;
    const int64_t sk = s * w.programs;
    for (int d = 0; d < w.programs * n; d++) w.dots[d] = vf{};
    for (int64_t c = 0; c < l.hidden; c += W)
        for (int i = 0; i < n; i++) {
            float* at = first + i * l.columns + c;
            const vf t = load(at);
            vf g{};
            for (int k = 0; k < w.programs; k++) {
                const vf d = load(w.dpooled + ((sk + k) * l.parts + 2) * l.hidden + c);
                g += w.avoided[(sk + k) * w.lanes + i] * d;
                w.dots[k * n + i] += d * t;
            }
            store(at, g * (1.0f - t * t));
        }
    sum_lanes(w.dots, (int64_t)w.programs * n, w.davoided);
}

// Adds ∂/∂p_avoid of program k to the gradient of its register.
inline void avoided_backward(const Net& net, Work& w, int64_t k, int64_t program) {
    const int set = w.sets[kAvoided][program], n = w.objects;
    if (set == net.shape->words) return;  // HAND: nothing is avoided
    float* out = w.dregister + (int64_t)set * w.lanes;
    for (int i = 0; i < n; i++)
        if (i != w.hand_index) out[i] += w.davoided[k * n + i];
}

}  // namespace pa::PA_LEVEL
