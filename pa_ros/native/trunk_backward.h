// From ∂/∂h back to the gradients of the trunk's parameters, for the chunk that `trunk_forward` left in
// Work. tanh of sums is computed again: five operations cost less than memory would.
#pragma once
#include "trunk.h"

namespace pa::PA_LEVEL {

// Gradients of local.0 and message.0 before tanh, in place of their activations; dots with what
// p and α multiplied: per program N² messages, N locals, one for the biases.
template <int KT>
void pool_backward(const Net& net, Work& w, int64_t s) {
    const Layout& l = net.l;
    const int n = w.objects, programs = KT ? KT : w.programs;
    const int64_t per_program = (int64_t)n * w.lanes, sk = s * programs, dots = w.dots_per_program();
    float *first = w.first_of(s, l.columns), *receiver = first + l.receiver;
    const float *p = w.relevant + sk * w.lanes, *weight = w.weight + sk * per_program;
    const float *dpooled = w.dpooled + sk * l.parts * l.hidden, *dh = w.dh + sk * l.hidden;
    const float* bias = net.p + l.second_bias;
    vf dreceiver[kMaxObjects], dlocal[KT ? KT : kMaxPrograms], dmessage[KT ? KT : kMaxPrograms];
    for (int64_t d = 0; d < programs * dots; d++) w.dots[d] = vf{};
    for (int64_t c = 0; c < l.hidden; c += W, first += W, receiver += W) {
        float* sender = receiver + (l.sender - l.receiver);
        const vf biases = load(bias + c) + load(bias + l.hidden + c);
        for (int k = 0; k < programs; k++) {
            dlocal[k] = load(dpooled + k * l.parts * l.hidden + c);
            dmessage[k] = load(dpooled + (k * l.parts + 1) * l.hidden + c);
            w.dots[k * dots + n * n + n] += load(dh + k * l.hidden + c) * biases;
        }
        for (int i = 0; i < n; i++) dreceiver[i] = vf{};
        for (int j = 0; j < n; j++) {
            const vf from = load(sender + j * l.columns);
            vf dsender{};
            for (int i = 0; i < n; i++) {
                const vf t = tanh_of_sum(load(receiver + i * l.columns), from);
                vf g{};
                for (int k = 0; k < programs; k++) {
                    g += weight[k * per_program + j * w.lanes + i] * dmessage[k];
                    w.dots[k * dots + j * n + i] += dmessage[k] * t;
                }
                g *= 1.0f - t * t;
                dsender += g;
                dreceiver[i] += g;
            }
            store(sender + j * l.columns, dsender);
            const vf f = load(first + j * l.columns);
            vf g{};
            for (int k = 0; k < programs; k++) {
                g += p[k * w.lanes + j] * dlocal[k];
                w.dots[k * dots + n * n + j] += dlocal[k] * f;
            }
            store(first + j * l.columns, g * (1.0f - f * f));
        }
        for (int i = 0; i < n; i++) store(receiver + i * l.columns, dreceiver[i]);
    }
    sum_lanes(w.dots, programs * dots, w.sums);
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
inline void attend_backward(const Net& net, Work& w, int64_t s, float* gradient) {
    const Layout& l = net.l;
    const int n = w.objects;
    float *query = w.first_of(s, l.columns) + l.query, *context = query + l.context - l.query;
    vf dquery[kMaxObjects];
    for (int64_t u = 0; u < l.attention; u += W) {
        const vf weight = load(net.p + l.attention_weight + u);
        vf dweight{};
        for (int i = 0; i < n; i++) dquery[i] = vf{};
        for (int j = 0; j < n; j++) {
            const vf from = load(context + j * l.columns + u);
            vf dcontext{};
            for (int i = 0; i < n; i++) {
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

using PoolBackward = void (*)(const Net&, Work&, int64_t);
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
    if (net.shape->avoids) pool_avoided_backward(net, w, s);
    if (net.shape->relations) pool_relations_backward(net, w, programs, s, gradient);
    else pool_backward_for(w.programs)(net, w, s);
    for (int i = 0; i < n * w.lanes; i++) w.dscore[i] = 0.0f;
    for (int64_t i = 0; i < (words + 1 + w.length) * w.lanes; i++) w.dregister[i] = 0.0f;
    for (int64_t k = 0; k < w.programs; k++) {
        const int64_t sk = s * w.programs + k;
        if (net.shape->roles) pairs_backward(net, w, k, sk, programs[sk]);
        else weigh_backward(net, w, k, sk);
        if (net.shape->avoids) avoided_backward(net, w, k, programs[sk]);
        run_program_backward(net, w, s, sk, programs[sk]);
    }
    attend_backward(net, w, s, gradient);
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
    float* first = gradient + l.first;
    for (int64_t from = 0; from < count; from += w.block) {
        const int64_t end = from + w.block < count ? from + w.block : count;
        for (int64_t s = from; s < end; s++) sample_backward(net, w, programs, s, gradient);
        multiply_add(features, c, (end - from) * w.objects,
                     {w.x + from * w.objects * features, 1, features}, w.first_of(from, c), c,
                     first, c);
    }
    multiply_add(arms, c, count, {w.arm, 1, arms}, w.first_arm, c, first + features * c, c);
    for (int64_t i = 0; i < h; i++) {  // both biases see Σp ∂/∂h; the sender has none
        gradient[l.second_bias + h + i] = gradient[l.second_bias + i];
        first[(l.rows - 1) * c + l.sender + i] = 0.0f;
    }
    for (int row = kPose; net.shape->hide_properties && row < features; row++)
        __builtin_memset(first + row * c, 0, l.detectors * sizeof(float));
}

}  // namespace pa::PA_LEVEL
