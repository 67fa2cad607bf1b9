// From h to the action or the value, and back. Rows are samples × programs.
#pragma once
#include "gemm.h"
#include "upper.h"
#include "work.h"

namespace pa::PA_LEVEL {

// A number known to the compiler, which then unrolls loops over it.
template <int N>
struct Known {
    constexpr operator int() const { return N; }
};

// Calls `work` with the number of actions: the usual ones known, others as they are.
template <class Code>
inline void with_actions(int actions, const Code& work) {
    if (actions == 6) return work(Known<6>{});
    if (actions == 7) return work(Known<7>{});
    work(actions);
}

// a = tanh(W tanh(h) + b) into w.action (lanes past the actions: tanh 0 = 0), tanh(h) into w.z;
// upper layers are between tanh(h) and W.
inline void actor_head(const Net& net, Work& w, int64_t rows) {
    const int64_t h = net.l.hidden;
    const float *weight = net.p + net.l.output, *bias = net.p + net.l.output_bias;
    const bool upper = net.shape->upper > 0;
    for (int64_t c = 0; upper && c < rows * h; c += W) store(w.z + c, tanh_of(load(w.h + c)));
    lift(net, w, rows);
    const float* last = top(net, w);
    alignas(64) float sum[kActionColumns] = {};
    with_actions(net.shape->actions, [&](auto actions) {
        for (int64_t r = 0; r < rows; r++) {
            vf dot[kMaxActions] = {};
            for (int64_t c = 0; c < h; c += W) {
                const vf z = upper ? load(last + r * h + c) : tanh_of(load(w.h + r * h + c));
                if (!upper) store(w.z + r * h + c, z);
                for (int a = 0; a < actions; a++) dot[a] += z * load(weight + a * h + c);
            }
            sum_lanes(dot, actions, sum);
            for (int o = 0; o < kActionColumns; o += W)
                store(w.action + r * kActionColumns + o, tanh_of(load(sum + o) + load(bias + o)));
        }
    });
}

// ∂/∂a (w.daction) → w.dh, adding the gradients of the output layer.
inline void actor_head_backward(const Net& net, Work& w, int64_t rows, const float* upper_t,
                                float* gradient) {
    const int64_t h = net.l.hidden;
    const float* last = top(net, w);
    const float* weight = net.p + net.l.output;
    float* bias = gradient + net.l.output_bias;
    with_actions(net.shape->actions, [&](auto actions) {
        for (int64_t r = 0; r < rows; r++) {
            float* d = w.daction + r * kActionColumns;
            for (int o = 0; o < kActionColumns; o += W) {
                const vf a = load(w.action + r * kActionColumns + o);
                store(d + o, load(d + o) * (1.0f - a * a));
                store(bias + o, load(bias + o) + load(d + o));
            }
            for (int64_t c = 0; c < h; c += W) {
                const vf z = load(last + r * h + c);
                vf g{};
                for (int a = 0; a < actions; a++) g += d[a] * load(weight + a * h + c);
                store(w.dh + r * h + c, g * (1.0f - z * z));
            }
        }
    });
    multiply_add(net.shape->actions, h, rows, {w.daction, 1, kActionColumns}, last, h,
                 gradient + net.l.output, h);
    sink(net, w, rows, upper_t, w.dh, gradient);
}

// Q = w tanh(h + L a + b) + c into w.q, tanh(…) into w.z; upper layers are between it and w. Row r's
// action is row r / share.
inline void critic_head(const Net& net, Work& w, const float* h_rows, const float* action,
                        int64_t stride, int64_t share, int64_t rows) {
    const int64_t h = net.l.hidden;
    const float *layer = net.p + net.l.action, *output = net.p + net.l.output;
    with_actions(net.shape->actions, [&](auto actions) {
        for (int64_t r = 0; r < rows; r++) {
            const float* a = action + r / share * stride;
            vf dot{};
            for (int64_t c = 0; c < h; c += W) {
                vf x = load(h_rows + r * h + c) + load(layer + actions * h + c);
                for (int i = 0; i < actions; i++) x += a[i] * load(layer + i * h + c);
                const vf z = tanh_of(x);
                store(w.z + r * h + c, z);
                dot += z * load(output + c);
            }
            float q[W];
            sum_lanes(&dot, 1, q);
            w.q[r] = q[0] + net.p[net.l.output_bias];
        }
    });
    if (!net.shape->upper) return;
    lift(net, w, rows);
    const float* last = top(net, w);
    for (int64_t r = 0; r < rows; r++) {
        vf dot{};
        for (int64_t c = 0; c < h; c += W) dot += load(last + r * h + c) * load(output + c);
        float q[W];
        sum_lanes(&dot, 1, q);
        w.q[r] = q[0] + net.p[net.l.output_bias];
    }
}

// ∂/∂Q (w.q) → w.dh, adding the gradients of the head. Row r's action is row r / share.
inline void critic_head_backward(const Net& net, Work& w, const float* action, int64_t share,
                                 int64_t rows, const float* upper_t, float* gradient) {
    const int64_t h = net.l.hidden;
    const float* last = top(net, w);
    const float* output = net.p + net.l.output;
    float *doutput = gradient + net.l.output, *layer = gradient + net.l.action;
    with_actions(net.shape->actions, [&](auto actions) {
        for (int64_t r = 0; r < rows; r++) {
            const float dq = w.q[r];
            gradient[net.l.output_bias] += dq;
            for (int64_t c = 0; c < h; c += W) {
                const vf z = load(last + r * h + c), dx = dq * load(output + c) * (1.0f - z * z);
                store(w.dh + r * h + c, dx);
                store(doutput + c, load(doutput + c) + dq * z);
            }
        }
        sink(net, w, rows, upper_t, w.dh, gradient);
        for (int64_t r = 0; r < rows; r++) {
            const float* a = action + r / share * actions;
            for (int64_t c = 0; c < h; c += W) {
                const vf dx = load(w.dh + r * h + c);
                store(layer + actions * h + c, load(layer + actions * h + c) + dx);
                for (int i = 0; i < actions; i++)
                    store(layer + i * h + c, load(layer + i * h + c) + a[i] * dx);
            }
        }
    });
}

// ∂Q/∂a of the rows that critic_head left in w.z, clipped to ±clip, less `penalty` times the action,
// and scaled, into w.daction.
inline void action_gradient(const Net& net, Work& w, int64_t rows, const float* upper_t, float clip,
                            float penalty, float scale) {
    const int64_t h = net.l.hidden;
    const bool upper = net.shape->upper > 0;
    const float *layer = net.p + net.l.action, *output = net.p + net.l.output;
    alignas(64) float sum[kActionColumns] = {};
    if (upper) {
        const float* last = top(net, w);
        for (int64_t r = 0; r < rows; r++)
            for (int64_t c = 0; c < h; c += W) {
                const vf z = load(last + r * h + c);
                store(w.dlift + r * h + c, load(output + c) * (1.0f - z * z));
            }
        sink(net, w, rows, upper_t, w.dlift, nullptr);
    }
    with_actions(net.shape->actions, [&](auto actions) {
        for (int64_t r = 0; r < rows; r++) {
            vf dot[kMaxActions] = {};
            for (int64_t c = 0; c < h; c += W) {
                const vf z = load(w.z + r * h + c);
                const vf dx = upper ? load(w.dlift + r * h + c) : load(output + c) * (1.0f - z * z);
                for (int i = 0; i < actions; i++) dot[i] += dx * load(layer + i * h + c);
            }
            sum_lanes(dot, actions, sum);
            for (int o = 0; o < kActionColumns; o += W)
                store(w.daction + r * kActionColumns + o,
                      scale * (at_least(at_most(load(sum + o), clip), -clip) -
                               penalty * load(w.action + r * kActionColumns + o)));
        }
    });
}

}  // namespace pa::PA_LEVEL
