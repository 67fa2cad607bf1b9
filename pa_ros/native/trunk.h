// From Ω and programs to h (docs/DESIGN.md, "Networks"; paper, eq. 4), for one chunk of samples.
//
// What does not depend on the program (first layers, α̃, tanh of messages) is computed once per
// sample whatever K. In sums over pairs j (sender) is the row and i (receiver) the lane.
#pragma once
#include "avoid.h"
#include "gemm.h"
#include "program.h"
#include "relations.h"
#include "roles.h"
#include "work.h"

namespace pa::PA_LEVEL {

inline constexpr float kNothing = 1e-30f;  // at least this is divided by

struct StartMass {  // row m starts from Σp · (local.1.bias + message.1.bias)
    const float *mass, *bias;
    int64_t hidden;
    vf operator()(int64_t m, int64_t n) const {
        return mass[m] * (load(bias + n) + load(bias + hidden + n));
    }
};

// In place: tanh for local and avoid; for the four kinds that meet in pairs, exponentials (see simd.h).
// Returns the largest |x| of those and `largest`.
inline vf activate(const Layout& l, float* row, vf largest) {
    for (int64_t c = 0; c < l.receiver; c += W) store(row + c, tanh_of(load(row + c)));
    for (int64_t c = l.receiver; c < l.detectors; c += W) {
        const bool receives = c < l.sender || (c >= l.query && c < l.context);
        const vf x = load(row + c), size = x < 0.0f ? -x : x;
        largest = size > largest ? size : largest;
        store(row + c, (receives ? 0.5f : 1.0f) * exponential_of_twice(x));
    }
    return largest;
}

// The arm's share reaches a pair through both of its objects. Each is given half of the total, so
// that large parts of opposite sign, which no pair ever sees, do not overflow the exponentials.
inline void balance_arm(const Layout& l, float* row) {
    const int64_t halves[2][3] = {{l.receiver, l.sender, l.hidden}, {l.query, l.context, l.attention}};
    for (const auto& [one, other, size] : halves)
        for (int64_t c = 0; c < size; c += W) {
            const vf half = 0.5f * (load(row + one + c) + load(row + other + c));
            store(row + one + c, half);
            store(row + other + c, half);
        }
}

// exp α̃_ij, up to a factor per receiver.
inline void attend(const Net& net, Work& w, int64_t s) {
    const Layout& l = net.l;
    const int n = w.objects;
    const float* first = w.first_of(s, l.columns);
    const float* weight = net.p + l.attention_weight;
    for (int j = 0; j < n; j++)
        for (int i = 0; i < n; i++) {
            const float *q = first + i * l.columns + l.query, *c = first + j * l.columns + l.context;
            vf sum{};
            for (int64_t u = 0; u < l.attention; u += W)
                sum += load(weight + u) * tanh_of_sum(load(q + u), load(c + u));
            w.dots[j * n + i] = sum;
        }
    sum_lanes(w.dots, (int64_t)n * n, w.sums);
    float *out = w.attend + s * n * w.lanes, all = w.sums[0];
    for (int k = 1; k < n * n; k++) all = w.sums[k] > all ? w.sums[k] : all;
    for (int o = 0; o < w.lanes; o += W) {
        vf most = loadu(w.sums + o);
        for (int j = 1; j < n; j++) {
            const vf x = loadu(w.sums + j * n + o);
            most = x > most ? x : most;
        }
        // The weights of pairs with roles sum to one over all receivers. Lanes without an object may
        // hold anything, so these are not compared with the largest score of all.
        if (net.shape->roles) most = load(w.mask + o) > 0.0f ? vf{} + all : most;
        for (int j = 0; j < n; j++)
            store(out + j * w.lanes + o, exponential(loadu(w.sums + j * n + o) - most));
    }
    for (int i = 0; i < n; i++) out[i * w.lanes + i] *= net.shape->self_weight;
}

// α_ij and p_i α_ij of one program; lanes without an object get 0, and where nothing is relevant
// to a receiver, it hears nothing.
inline void weigh(Work& w, int64_t s, int64_t sk) {
    const int n = w.objects;
    const float *p = w.relevant + sk * w.lanes, *e = w.attend + s * n * w.lanes;
    float *share = w.share + sk * n * w.lanes, *weight = w.weight + sk * n * w.lanes;
    for (int o = 0; o < w.lanes; o += W) {
        vf total{};
        for (int j = 0; j < n; j++) total += p[j] * load(e + j * w.lanes + o);
        total = total > kNothing ? total : vf{} + kNothing;
        const vf inverse = load(w.mask + o) > 0.0f ? 1.0f / total : vf{};
        const vf receiver = load(p + o);
        for (int j = 0; j < n; j++) {
            const vf part = load(e + j * w.lanes + o) * inverse;
            store(share + j * w.lanes + o, part);
            store(weight + j * w.lanes + o, p[j] * part * receiver);
        }
    }
}

// Σ p_i tanh(f0_i) and Σ p_i α_ij tanh(r0_ij) of all K programs of a sample, of V vectors of units from
// unit c on. KT: K, or 0 for any.
template <int KT, int V>
inline void pool_units(const Net& net, Work& w, const Pairs& pairs, int64_t s, int64_t c) {
    const Layout& l = net.l;
    const int n = w.objects, programs = KT ? KT : w.programs;
    const int64_t per_program = (int64_t)n * w.lanes, sk = s * programs;
    const float *first = w.first_of(s, l.columns) + c, *receiver = first + l.receiver;
    const float *sender = first + l.sender, *p = w.relevant + sk * w.lanes;
    const float* weight = w.weight + sk * per_program;
    float* out = w.pooled + sk * l.parts * l.hidden + c;
    vf local[KT ? KT : kMaxPrograms][V], message[KT ? KT : kMaxPrograms][V];
    for (int k = 0; k < programs; k++)
        for (int v = 0; v < V; v++) local[k][v] = message[k][v] = vf{};
    for (int j = 0; j < n; j++)
        for (int v = 0; v < V; v++) {
            const vf f = load(first + j * l.columns + v * W);
            for (int k = 0; k < programs; k++) local[k][v] += p[k * w.lanes + j] * f;
        }
    for (int b = 0; b < pairs.senders; b++) {
        const int j = pairs.sender[b];
        vf from[V];
        for (int v = 0; v < V; v++) from[v] = load(sender + j * l.columns + v * W);
        for (int a = 0; a < pairs.receivers; a++) {
            const int i = pairs.receiver[a];
            for (int v = 0; v < V; v++) {
                const vf t = tanh_of_sum(load(receiver + i * l.columns + v * W), from[v]);
                for (int k = 0; k < programs; k++)
                    message[k][v] += weight[k * per_program + j * w.lanes + i] * t;
            }
        }
    }
    for (int k = 0; k < programs; k++)
        for (int v = 0; v < V; v++) {
            store(out + k * l.parts * l.hidden + v * W, local[k][v]);
            store(out + (k * l.parts + 1) * l.hidden + v * W, message[k][v]);
        }
}

// Vectors of units that go through the pairs together: independent sums hide each other's latency, as far
// as registers hold those of all programs.
constexpr int units_together(int programs) { return programs == 1 || programs == 2 ? 2 : 1; }

template <int KT>
void pool(const Net& net, Work& w, const Pairs& pairs, int64_t s) {
    constexpr int V = units_together(KT);
    int64_t c = 0;
    for (; c + V * W <= net.l.hidden; c += V * W) pool_units<KT, V>(net, w, pairs, s, c);
    for (; c < net.l.hidden; c += W) pool_units<KT, 1>(net, w, pairs, s, c);
}

using Pool = void (*)(const Net&, Work&, const Pairs&, int64_t);
inline Pool pool_for(int programs) {
    static const Pool fixed[] = {pool<0>, pool<1>, pool<2>, pool<3>, pool<4>,
                                 pool<5>, pool<6>, pool<7>, pool<8>};
    return programs <= 8 ? fixed[programs] : fixed[0];
}

// How many of the first columns have zero weights for the properties.
inline int64_t blind_columns(const Net& net) {
    return net.shape->hide_properties ? net.l.detectors : 0;
}

// Everything up to the sums of samples [from, from + count), whose `first` stays in cache.
inline void forward_block(const Net& net, Work& w, const int32_t* programs, int64_t from,
                          int count) {
    const Layout& l = net.l;
    const int64_t rows = (int64_t)count * w.objects, c = l.columns;
    const int64_t features = net.shape->object_features, arms = net.shape->arm_features + 1;
    const float* weight = net.p + l.first;
    float *first = w.first_of(from, c), *arm = w.first_arm + from * c;
    multiply(count, c, arms, {w.arm + from * arms, arms, 1}, weight + features * c, c, arm, c,
             FromZero{});
    for (int s = 0; s < count; s++) balance_arm(l, arm + s * c);
    const float* x = w.x + from * w.objects * features;
    const int64_t blind = blind_columns(net);
    multiply(rows, blind, kPose, {x, features, 1}, weight, c, first, c, FromRows{arm, c, w.objects});
    multiply(rows, c - blind, features, {x, features, 1}, weight + blind, c, first + blind, c,
             FromRows{arm + blind, c, w.objects});
    vf largest = load(w.largest);
    for (int64_t r = 0; r < rows; r++) largest = activate(l, first + r * c, largest);
    store(w.largest, largest);
    evaluate_phi(net, w, from, count);
    const Pool pool_sample = pool_for(w.programs);
    for (int64_t s = from; s < from + count; s++) {
        attend(net, w, s);
        const Pairs pairs = pairs_of(net, w, programs + s * w.programs);
        for (int64_t sk = s * w.programs; sk < (s + 1) * w.programs; sk++) {
            run_program(net, w, s, sk, programs[sk]);
            if (net.shape->roles) {
                assign_roles(net, w, s, sk, programs[sk]);
                weigh_pairs(w, pairs, s, sk);
            } else {
                weigh(w, s, sk);
            }
            if (net.shape->avoids) assign_avoided(net, w, s, sk, programs[sk]);
        }
        const int relation = shared_relation(net, w, programs + s * w.programs);
        if (relation >= 0) receive_all(net, w, relation, s);
        if (net.shape->relations && relation < 0) pool_relations(net, w, programs, s);
        else pool_sample(net, w, pairs, s);
        if (net.shape->avoids) pool_avoided(net, w, s);
    }
}

// Φ and the registers of the first program on the first sample, from w.x and w.arm; the same bits as in
// `forward_block`.
inline void relevance_forward(const Net& net, Work& w) {
    const Layout& l = net.l;
    const int64_t features = net.shape->object_features, arms = net.shape->arm_features + 1, c = l.columns;
    const float* weight = net.p + l.first + l.detectors;
    float *first = w.first + l.detectors, *arm = w.first_arm + l.detectors;
    w.ring = 1;
    if (net.shape->detectors) {
        multiply(1, c - l.detectors, arms, {w.arm, arms, 1}, weight + features * c, c, arm, c, FromZero{});
        multiply(w.objects, c - l.detectors, features, {w.x, features, 1}, weight, c, first, c,
                 FromRows{arm, c, w.objects});
    }
    evaluate_phi(net, w, 0, 1);
    run_program(net, w, 0, 0, 0);
}

// h of every sample and program of the chunk, from w.x and w.arm. `programs` is [count, K].
// `keep`: leave the activations of the whole chunk in w.first, for `trunk_backward`.
inline void trunk_forward(const Net& net, Work& w, const int32_t* programs, int count, bool keep) {
    const Layout& l = net.l;
    w.ring = keep ? w.samples : w.block;
    relation_factors(net, w);
    for (int from = 0; from < count; from += w.block)
        forward_block(net, w, programs, from, count - from < w.block ? count - from : w.block);
    const int64_t pairs = (int64_t)count * w.programs, h = l.hidden, each = l.parts * h;
    const float* second = net.p + l.second;
    multiply(pairs, h, net.shape->hidden, {w.pooled, each, 1}, second, h, w.h, h,
             StartMass{w.mass, net.p + l.second_bias, h});
    for (int64_t part = 1; part < l.parts; part++)
        multiply_add(pairs, h, net.shape->hidden, {w.pooled + part * h, each, 1}, second + part * h * h,
                     h, w.h, h);
}

}  // namespace pa::PA_LEVEL
