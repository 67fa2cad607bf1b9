// From ∂/∂h back to the gradients of the trunk's parameters, for the chunk that `trunk_forward` left in
// Work. tanh of sums is computed again: five operations cost less than memory would.
#pragma once
#include "trunk.h"

namespace pa::PA_LEVEL {

// Gradients of local.0 and message.0 before tanh, in place of their activations, of V vectors of units
// from unit c on; adds to dots with what p and α multiplied: per program N² messages, N locals, one for
// the biases.
template <int KT, int V>
inline void pool_units_backward(const Net& net, Work& w, const Pairs& pairs, int64_t s, int64_t c) {
    const Layout& l = net.l;
    const int n = w.objects, programs = KT ? KT : w.programs;
    const int64_t per_program = (int64_t)n * w.lanes, sk = s * programs, dots = w.dots_per_program();
    float *first = w.first_of(s, l.columns) + c, *receiver = first + l.receiver;
    float* sender = first + l.sender;
    const float *p = w.relevant + sk * w.lanes, *weight = w.weight + sk * per_program;
    const float *dpooled = w.dpooled + sk * l.parts * l.hidden + c, *dh = w.dh + sk * l.hidden + c;
    const float* bias = net.p + l.second_bias + c;
    vf dreceiver[kMaxObjects][V], dlocal[KT ? KT : kMaxPrograms][V], dmessage[KT ? KT : kMaxPrograms][V];
    for (int k = 0; k < programs; k++)
        for (int v = 0; v < V; v++) {
            const int64_t at = v * W;
            dlocal[k][v] = load(dpooled + k * l.parts * l.hidden + at);
            dmessage[k][v] = load(dpooled + (k * l.parts + 1) * l.hidden + at);
            w.dots[k * dots + n * n + n] +=
                load(dh + k * l.hidden + at) * (load(bias + at) + load(bias + l.hidden + at));
        }
    for (int i = 0; i < n; i++)
        for (int v = 0; v < V; v++) dreceiver[i][v] = vf{};
    for (int j = 0, b = 0; j < n; j++) {
        const bool sends = b < pairs.senders && pairs.sender[b] == j;
        b += sends;
        vf from[V], dsender[V];
        for (int v = 0; v < V; v++) from[v] = load(sender + j * l.columns + v * W), dsender[v] = vf{};
        for (int a = 0; sends && a < pairs.receivers; a++) {
            const int i = pairs.receiver[a];
            for (int v = 0; v < V; v++) {
                const vf t = tanh_of_sum(load(receiver + i * l.columns + v * W), from[v]);
                vf g{};
                for (int k = 0; k < programs; k++) {
                    g += weight[k * per_program + j * w.lanes + i] * dmessage[k][v];
                    w.dots[k * dots + j * n + i] += dmessage[k][v] * t;
                }
                g *= 1.0f - t * t;
                dsender[v] += g;
                dreceiver[i][v] += g;
            }
        }
        for (int v = 0; v < V; v++) {
            store(sender + j * l.columns + v * W, dsender[v]);
            float* at = first + j * l.columns + v * W;
            const vf f = load(at);
            vf g{};
            for (int k = 0; k < programs; k++) {
                g += p[k * w.lanes + j] * dlocal[k][v];
                w.dots[k * dots + n * n + j] += dlocal[k][v] * f;
            }
            store(at, g * (1.0f - f * f));
        }
    }
    for (int i = 0; i < n; i++)
        for (int v = 0; v < V; v++) store(receiver + i * l.columns + v * W, dreceiver[i][v]);
}

template <int KT>
void pool_backward(const Net& net, Work& w, const Pairs& pairs, int64_t s) {
    constexpr int V = units_together(KT);
    const int64_t dots = (KT ? KT : w.programs) * w.dots_per_program();
    for (int64_t d = 0; d < dots; d++) w.dots[d] = vf{};
    int64_t c = 0;
    for (; c + V * W <= net.l.hidden; c += V * W) pool_units_backward<KT, V>(net, w, pairs, s, c);
    for (; c < net.l.hidden; c += W) pool_units_backward<KT, 1>(net, w, pairs, s, c);
    sum_lanes(w.dots, dots, w.sums);
}

// Of one program: adds ∂/∂α̃ to w.dscore and leaves ∂/∂p in the last register's gradient.
inline void weigh_backward(const Net& net, Work& w, int64_t k, int64_t sk) {
    const int n = w.objects;
    const float *sums = w.sums + k * w.dots_per_program(), *p = w.relevant + sk * w.lanes;
    const float* share = w.share + sk * n * w.lanes;
    float* dp = w.dregister + (net.shape->words + w.length) * w.lanes;
    vf sent[kMaxObjects];  // ∂/∂p_j, one term per receiver lane
    for (int j = 0; j < n; j++) sent[j] = vf{};
    for (int o = 0; o < w.lanes; o += W) {
        const vf receiver = load(p + o);
        vf dreceiver{};  // Σ_j ∂/∂(p_i α_ij) α_ij
        for (int j = 0; j < n; j++)
            dreceiver += loadu(sums + j * n + o) * (p[j] * load(share + j * w.lanes + o));
        const vf mean = dreceiver * receiver;  // Σ_j ∂/∂α_ij α_ij
        for (int j = 0; j < n; j++) {
            const vf t = load(share + j * w.lanes + o) * (loadu(sums + j * n + o) * receiver - mean);
            sent[j] += t;
            store(w.dscore + j * w.lanes + o, load(w.dscore + j * w.lanes + o) + p[j] * t);
        }
        store(dp + o, dreceiver + loadu(sums + n * n + o) + sums[n * n + n]);
    }
    float total[kMaxObjects + kLane];
    sum_lanes(sent, n, total);
    for (int j = 0; j < n; j++) dp[j] += total[j];
}

// Gradients of query and context before tanh, in place of their activations; adds attention's.
inline void attend_backward(const Net& net, Work& w, const Pairs& pairs, int64_t s,
                            float* gradient) {
    const Layout& l = net.l;
    const int n = w.objects;
    float *query = w.first_of(s, l.columns) + l.query, *context = query + l.context - l.query;
    vf dquery[kMaxObjects];
    for (int64_t u = 0; u < l.attention; u += W) {
        const vf weight = load(net.p + l.attention_weight + u);
        vf dweight{};
        for (int i = 0; i < n; i++) dquery[i] = vf{};
        for (int j = 0, b = 0; j < n; j++) {
            const vf from = load(context + j * l.columns + u);
            const bool sends = b < pairs.senders && pairs.sender[b] == j;
            b += sends;
            vf dcontext{};
            for (int a = 0; sends && a < pairs.receivers; a++) {
                const int i = pairs.receiver[a];
                const vf t = tanh_of_sum(load(query + i * l.columns + u), from);
                const float d = w.dscore[j * w.lanes + i];
                dweight += d * t;
                const vf g = d * (1.0f - t * t);
                dcontext += g;
                dquery[i] += g;
            }
            store(context + j * l.columns + u, dcontext * weight);
        }
        for (int i = 0; i < n; i++) store(query + i * l.columns + u, dquery[i] * weight);
        float* out = gradient + l.attention_weight + u;
        store(out, load(out) + dweight);
    }
}

using PoolBackward = void (*)(const Net&, Work&, const Pairs&, int64_t);
inline PoolBackward pool_backward_for(int programs) {
    static const PoolBackward fixed[] = {
        pool_backward<0>, pool_backward<1>, pool_backward<2>, pool_backward<3>, pool_backward<4>,
        pool_backward<5>, pool_backward<6>, pool_backward<7>, pool_backward<8>};
    return programs <= 8 ? fixed[programs] : fixed[0];
}

inline void sample_backward(const Net& net, Work& w, const int32_t* programs, int64_t s,
                            float* gradient) {
    const Layout& l = net.l;
    const int words = net.shape->words, n = w.objects;
    const Pairs pairs = pairs_of(net, w, programs + s * w.programs);
    if (net.shape->avoids) pool_avoided_backward(net, w, s);
    const int relation = shared_relation(net, w, programs + s * w.programs);
    if (net.shape->relations && relation < 0) pool_relations_backward(net, w, programs, s, gradient);
    else pool_backward_for(w.programs)(net, w, pairs, s);
    if (relation >= 0) relation_backward(net, w, relation, s, gradient);
    for (int i = 0; i < n * w.lanes; i++) w.dscore[i] = 0.0f;
    for (int64_t i = 0; i < (words + 1 + w.length) * w.lanes; i++) w.dregister[i] = 0.0f;
    for (int64_t k = 0; k < w.programs; k++) {
        const int64_t sk = s * w.programs + k;
        if (net.shape->roles) pairs_backward(net, w, pairs, k, sk, programs[sk]);
        else weigh_backward(net, w, k, sk);
        if (net.shape->avoids) avoided_backward(net, w, k, programs[sk]);
        run_program_backward(net, w, s, sk, programs[sk]);
    }
    attend_backward(net, w, pairs, s, gradient);
    if (net.shape->detectors) detectors_backward(net, w, s);
    const float* first = w.first_of(s, l.columns);
    float* sum = w.first_arm + s * l.columns;
    for (int64_t c = 0; c < l.columns; c += W) {
        vf total{};
        for (int i = 0; i < n; i++) total += load(first + i * l.columns + c);
        store(sum + c, total);
    }
}

// Adds the trunk's gradients, given w.dh. `second_t` is `second` transposed, [H, 2H or 3H].
inline void trunk_backward(const Net& net, Work& w, const int32_t* programs, int count,
                           const float* second_t, float* gradient) {
    const Layout& l = net.l;
    const int64_t pairs = (int64_t)count * w.programs;
    const int64_t h = l.hidden, c = l.columns, size = net.shape->hidden, each = l.parts * h;
    const int64_t features = net.shape->object_features, arms = net.shape->arm_features + 1;
    float* second = gradient + l.second;
    multiply(pairs, each, size, {w.dh, h, 1}, second_t, each, w.dpooled, each, FromZero{});
    for (int64_t part = 0; part < l.parts; part++)
        multiply_add(size, h, pairs, {w.pooled + part * h, 1, each}, w.dh, h, second + part * h * h, h);
    multiply_add(1, h, pairs, {w.mass, 0, 1}, w.dh, h, gradient + l.second_bias, h);
    const int64_t blind = blind_columns(net);
    float* first = gradient + l.first;
    for (int64_t from = 0; from < count; from += w.block) {
        const int64_t end = from + w.block < count ? from + w.block : count;
        for (int64_t s = from; s < end; s++) sample_backward(net, w, programs, s, gradient);
        const float *x = w.x + from * w.objects * features, *d = w.first_of(from, c);
        const int64_t rows = (end - from) * w.objects;
        multiply_add(kPose, blind, rows, {x, 1, features}, d, c, first, c);
        multiply_add(features, c - blind, rows, {x, 1, features}, d + blind, c, first + blind, c);
    }
    multiply_add(arms, c, count, {w.arm, 1, arms}, w.first_arm, c, first + features * c, c);
    for (int64_t i = 0; i < h; i++) {  // both biases see Σp ∂/∂h; the sender has none
        gradient[l.second_bias + h + i] = gradient[l.second_bias + i];
        first[(l.rows - 1) * c + l.sender + i] = 0.0f;
    }
}

}  // namespace pa::PA_LEVEL
