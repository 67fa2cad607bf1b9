// Roles: what a program moves receives messages, its target sends them (docs/DESIGN.md, "Roles").
#pragma once
#include "program.h"

namespace pa::PA_LEVEL {

inline constexpr float kLittle = 1e-6f;  // added to the sum of the pairs' weights

// Which objects may have a p1, and which a p2, of any program of a sample; without roles, all. Pairs of
// others weigh exactly 0, and no gradient of theirs is needed.
struct Pairs {
    int receivers, senders, receiver[kMaxObjects], sender[kMaxObjects];
};

inline Pairs pairs_of(const Net& net, const Work& w, const int32_t* programs) {
    bool hand[2] = {}, others[2] = {};
    for (int role = kMoved; role <= kTarget; role++)
        for (int k = 0; k < w.programs; k++) {
            const bool of_hand = net.shape->roles && w.sets[role][programs[k]] == net.shape->words;
            hand[role] = hand[role] || of_hand || !net.shape->roles;
            others[role] = others[role] || !of_hand;
        }
    Pairs pairs;
    pairs.receivers = pairs.senders = 0;
    for (int i = 0; i < w.objects; i++) {
        if (i == w.hand_index ? hand[0] : others[0]) pairs.receiver[pairs.receivers++] = i;
        if (i == w.hand_index ? hand[1] : others[1]) pairs.sender[pairs.senders++] = i;
    }
    return pairs;
}

// p1 and p2 of a program that has run, in w.moved and w.senders.
inline void assign_roles(const Net& net, Work& w, int64_t s, int64_t sk, int64_t program) {
    for (int role = kMoved; role <= kTarget; role++) {
        float* out = (role == kMoved ? w.moved : w.senders) + sk * w.lanes;
        for (int i = w.objects; i < w.lanes; i++) out[i] = 0.0f;
        read_set(net, w, s, sk, w.sets[role][program], out);
    }
}

// Weights of pairs, p1_i p2_j exp α̃_ij as shares of their sum; what each i receives in all in
// w.relevant, and in w.mass the sum of that. w.share has the weights without p1 and p2.
inline void weigh_pairs(Work& w, const Pairs& pairs, int64_t s, int64_t sk) {
    const int n = w.objects;
    const float *e = w.attend + s * n * w.lanes, *senders = w.senders + sk * w.lanes;
    const float* moved = w.moved + sk * w.lanes;
    float *share = w.share + sk * n * w.lanes, *weight = w.weight + sk * n * w.lanes;
    float* received = w.relevant + sk * w.lanes;
    float total = kLittle, mass = 0.0f;
    for (int b = 0; b < pairs.senders; b++)
        for (int a = 0; a < pairs.receivers; a++) {
            const int j = pairs.sender[b], i = pairs.receiver[a];
            total += moved[i] * senders[j] * e[j * w.lanes + i];
        }
    const float inverse = 1.0f / total;
    for (int o = 0; o < w.lanes; o += W) {
        const vf receiver = load(moved + o);
        const vf there = load(w.mask + o) > 0.0f ? vf{} + inverse : vf{};
        vf sum{};
        for (int j = 0; j < n; j++) {
            const vf part = load(e + j * w.lanes + o) * there, pair = senders[j] * part * receiver;
            store(share + j * w.lanes + o, part);
            store(weight + j * w.lanes + o, pair);
            sum += pair;
        }
        store(received + o, sum);
    }
    for (int i = 0; i < n; i++) mass += received[i];
    w.mass[sk] = mass;
}

// Of one program, from the sums of `pool_backward`: adds ∂/∂α̃ to w.dscore, and ∂/∂ p1 and p2 to the
// gradients of their registers.
inline void pairs_backward(const Net& net, Work& w, const Pairs& pairs, int64_t k, int64_t sk, int64_t program) {
    const int n = w.objects;
    const float *sums = w.sums + k * w.dots_per_program(), *share = w.share + sk * n * w.lanes;
    const float *moved = w.moved + sk * w.lanes, *senders = w.senders + sk * w.lanes;
    const float* weight = w.weight + sk * n * w.lanes;
    float *dmoved = w.drole, *dsenders = w.drole + w.lanes, mean = 0.0f;
    const auto slope = [&](int i, int j) {  // of the weight of a pair: its message, i's f, biases
        return sums[j * n + i] + sums[n * n + i] + sums[n * n + n];
    };
    for (int b = 0; b < pairs.senders; b++)
        for (int a = 0; a < pairs.receivers; a++) {
            const int j = pairs.sender[b], i = pairs.receiver[a];
            mean += weight[j * w.lanes + i] * slope(i, j);
        }
    for (int i = 0; i < w.lanes; i++) dmoved[i] = dsenders[i] = 0.0f;
    for (int b = 0; b < pairs.senders; b++)
        for (int a = 0; a < pairs.receivers; a++) {
            const int j = pairs.sender[b], i = pairs.receiver[a];
            const float d = share[j * w.lanes + i] * (slope(i, j) - mean);
            dmoved[i] += senders[j] * d;
            dsenders[j] += moved[i] * d;
            w.dscore[j * w.lanes + i] += moved[i] * senders[j] * d;
        }
    for (int role = kMoved; role <= kTarget; role++) {
        const int set = w.sets[role][program];
        if (set == net.shape->words) continue;  // HAND
        float* out = w.dregister + (int64_t)set * w.lanes;
        for (int i = 0; i < n; i++)
            if (i != w.hand_index) out[i] += w.drole[role * w.lanes + i];
    }
}

}  // namespace pa::PA_LEVEL
