// Roles: what a program moves receives messages, its target sends them (docs/DESIGN.md, "Roles").
#pragma once
#include "program.h"

namespace pa::PA_LEVEL {

inline constexpr float kLittle = 1e-4f;  // added to the sum of degrees before they are divided by it

// The shares of both sets of a program that has run: w.relevant, whose sum is w.mass, and w.senders.
inline void assign_roles(const Net& net, Work& w, int64_t s, int64_t sk, int64_t program) {
    const int words = net.shape->words;
    for (int role = 0; role < 2; role++) {
        const int set = w.roles[2 * program + role];
        const float* degree = register_at(w, words, s, sk, set);
        float* share = (role ? w.senders : w.relevant) + sk * w.lanes;
        float total = 0.0f, mass = 0.0f;
        for (int i = 0; i < w.lanes; i++) {
            const bool there = i < w.objects && (i != w.hand_index || set == words);
            share[i] = there ? degree[i] : 0.0f;
            total += share[i];
        }
        const float inverse = w.inverse[2 * sk + role] = 1.0f / (total + kLittle);
        for (int i = 0; i < w.lanes; i++) mass += share[i] *= inverse;
        if (!role) w.mass[sk] = mass;
    }
}

// From ∂/∂ both shares (w.drole) to the gradients of their registers, which it adds.
inline void roles_backward(const Net& net, Work& w, int64_t sk, int64_t program) {
    for (int role = 0; role < 2; role++) {
        const int set = w.roles[2 * program + role];
        if (set == net.shape->words) continue;  // HAND
        const float* share = (role ? w.senders : w.relevant) + sk * w.lanes;
        const float* d = w.drole + role * w.lanes;
        float *out = w.dregister + (int64_t)set * w.lanes, mean = 0.0f;
        for (int i = 0; i < w.objects; i++) mean += d[i] * share[i];
        for (int i = 0; i < w.objects; i++)
            if (i != w.hand_index) out[i] += w.inverse[2 * sk + role] * (d[i] - mean);
    }
}

}  // namespace pa::PA_LEVEL
