// Messages in a world of several relations (docs/DESIGN.md, "Networks"): programs of one relation
// share them, the others' differ by what their relation adds to the sums under tanh.
//
// The receiver's part x of a sum is kept as e^2x / 2, so that adding e to it is a product with e^2e.
#pragma once
#include "work.h"

namespace pa::PA_LEVEL {

// e^2e of every relation, [R, H], for the network whose `forward` begins.
inline void relation_factors(const Net& net, Work& w) {
    const float* added = net.p + net.l.relation;
    for (int64_t c = 0; c < net.shape->relations * net.l.hidden; c += W)
        store(w.factor + c, exponential_of_twice(load(added + c)));
}

// A sample's programs by relation: those of the q-th that occurs are member[begin[q]] and so on.
struct Asked {
    int count, relation[kMaxPrograms], begin[kMaxPrograms + 1], member[kMaxPrograms];
};

inline Asked asked_by(const Work& w, const int32_t* programs) {
    Asked asked;
    asked.count = 0;
    int members = 0;
    for (int k = 0; k < w.programs; k++) {
        const int relation = w.relation[programs[k]];
        bool known = false;
        for (int q = 0; q < asked.count; q++) known = known || asked.relation[q] == relation;
        if (known) continue;
        asked.begin[asked.count] = members;
        asked.relation[asked.count++] = relation;
        for (int other = k; other < w.programs; other++)
            if (w.relation[programs[other]] == relation) asked.member[members++] = other;
    }
    asked.begin[asked.count] = members;
    return asked;
}

// The relation of all programs of a sample; -1 if they have several, or the network knows none.
inline int shared_relation(const Net& net, const Work& w, const int32_t* programs) {
    if (!net.shape->relations) return -1;
    for (int k = 1; k < w.programs; k++)
        if (w.relation[programs[k]] != w.relation[programs[0]]) return -1;
    return w.relation[programs[0]];
}

// Makes the receivers' parts of a sample what one relation has, so that `pool` and `pool_backward` serve.
inline void receive_all(const Net& net, Work& w, int relation, int64_t s) {
    const Layout& l = net.l;
    float* receiver = w.first_of(s, l.columns) + l.receiver;
    for (int i = 0; i < w.objects; i++, receiver += l.columns)
        for (int64_t c = 0; c < l.hidden; c += W)
            store(receiver + c, load(w.factor + relation * l.hidden + c) * load(receiver + c));
}

// After `pool_backward`: adds the gradient of what the relation adds, that of all senders.
inline void relation_backward(const Net& net, const Work& w, int relation, int64_t s, float* gradient) {
    const Layout& l = net.l;
    const float* sender = w.first_of(s, l.columns) + l.sender;
    for (int64_t c = 0; c < l.hidden; c += W) {
        vf added{};
        for (int j = 0; j < w.objects; j++) added += load(sender + j * l.columns + c);
        float* out = gradient + l.relation + relation * l.hidden + c;
        store(out, load(out) + added);
    }
}

// The receivers' parts of W units, as one relation has them.
inline void receive(const Net& net, const Work& w, int relation, const float* receiver, int64_t c,
                    vf* as_asked) {
    const vf factor = load(w.factor + relation * net.l.hidden + c);
    for (int i = 0; i < w.objects; i++) as_asked[i] = factor * load(receiver + i * net.l.columns);
}

// As `pool`, of a sample whose programs have several relations.
inline void pool_relations(const Net& net, Work& w, const int32_t* programs, int64_t s) {
    const Layout& l = net.l;
    const int n = w.objects;
    const int64_t per_program = (int64_t)n * w.lanes, sk = s * w.programs;
    const float *first = w.first_of(s, l.columns), *receiver = first + l.receiver;
    const float *p = w.relevant + sk * w.lanes, *weight = w.weight + sk * per_program;
    float* out = w.pooled + sk * 2 * l.hidden;
    const Asked asked = asked_by(w, programs + sk);
    vf local[kMaxPrograms], message[kMaxPrograms], as_asked[kMaxObjects];
    for (int64_t c = 0; c < l.hidden; c += W, first += W, receiver += W, out += W) {
        const float* sender = receiver + (l.sender - l.receiver);
        for (int k = 0; k < w.programs; k++) local[k] = message[k] = vf{};
        for (int j = 0; j < n; j++) {
            const vf f = load(first + j * l.columns);
            for (int k = 0; k < w.programs; k++) local[k] += p[k * w.lanes + j] * f;
        }
        for (int q = 0; q < asked.count; q++) {
            receive(net, w, asked.relation[q], receiver, c, as_asked);
            for (int j = 0; j < n; j++) {
                const vf from = load(sender + j * l.columns);
                for (int i = 0; i < n; i++) {
                    const vf t = tanh_of_sum(as_asked[i], from);
                    for (int m = asked.begin[q]; m < asked.begin[q + 1]; m++) {
                        const int k = asked.member[m];
                        message[k] += weight[k * per_program + j * w.lanes + i] * t;
                    }
                }
            }
        }
        for (int k = 0; k < w.programs; k++) {
            store(out + k * 2 * l.hidden, local[k]);
            store(out + k * 2 * l.hidden + l.hidden, message[k]);
        }
    }
}

// As `pool_backward`; adds the gradients of what relations add.
inline void pool_relations_backward(const Net& net, Work& w, const int32_t* programs, int64_t s,
                                    float* gradient) {
    const Layout& l = net.l;
    const int n = w.objects;
    const int64_t per_program = (int64_t)n * w.lanes, sk = s * w.programs, dots = w.dots_per_program();
    float *first = w.first_of(s, l.columns), *receiver = first + l.receiver;
    const float *p = w.relevant + sk * w.lanes, *weight = w.weight + sk * per_program;
    const float *dpooled = w.dpooled + sk * 2 * l.hidden, *dh = w.dh + sk * l.hidden;
    const float* bias = net.p + l.second_bias;
    const Asked asked = asked_by(w, programs + sk);
    vf dlocal[kMaxPrograms], dmessage[kMaxPrograms];
    vf as_asked[kMaxObjects], dreceiver[kMaxObjects], dsender[kMaxObjects];
    for (int64_t d = 0; d < w.programs * dots; d++) w.dots[d] = vf{};
    for (int64_t c = 0; c < l.hidden; c += W, first += W, receiver += W) {
        float* sender = receiver + (l.sender - l.receiver);
        const vf biases = load(bias + c) + load(bias + l.hidden + c);
        for (int k = 0; k < w.programs; k++) {
            dlocal[k] = load(dpooled + k * 2 * l.hidden + c);
            dmessage[k] = load(dpooled + k * 2 * l.hidden + l.hidden + c);
            w.dots[k * dots + n * n + n] += load(dh + k * l.hidden + c) * biases;
        }
        for (int i = 0; i < n; i++) dreceiver[i] = dsender[i] = vf{};
        for (int q = 0; q < asked.count; q++) {
            receive(net, w, asked.relation[q], receiver, c, as_asked);
            vf dadded{};
            for (int j = 0; j < n; j++) {
                const vf from = load(sender + j * l.columns);
                vf sent{};
                for (int i = 0; i < n; i++) {
                    const vf t = tanh_of_sum(as_asked[i], from);
                    vf g{};
                    for (int m = asked.begin[q]; m < asked.begin[q + 1]; m++) {
                        const int k = asked.member[m];
                        g += weight[k * per_program + j * w.lanes + i] * dmessage[k];
                        w.dots[k * dots + j * n + i] += dmessage[k] * t;
                    }
                    g *= 1.0f - t * t;
                    sent += g;
                    dreceiver[i] += g;
                }
                dsender[j] += sent;
                dadded += sent;
            }
            float* out = gradient + l.relation + asked.relation[q] * l.hidden + c;
            store(out, load(out) + dadded);
        }
        for (int j = 0; j < n; j++) {
            store(sender + j * l.columns, dsender[j]);
            store(receiver + j * l.columns, dreceiver[j]);
            const vf f = load(first + j * l.columns);
            vf g{};
            for (int k = 0; k < w.programs; k++) {
                g += p[k * w.lanes + j] * dlocal[k];
                w.dots[k * dots + n * n + j] += dlocal[k] * f;
            }
            store(first + j * l.columns, g * (1.0f - f * f));
        }
    }
    sum_lanes(w.dots, w.programs * dots, w.sums);
}

}  // namespace pa::PA_LEVEL
