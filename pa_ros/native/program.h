// Φ and the flat programs on it, forward and backward; lanes are objects.
#pragma once
#include "work.h"

namespace pa::PA_LEVEL {

// x op y = c0 + c1·x + c2·y + c3·x·y, for NOT, AND, OR, COPY (paper, eq. logic).
inline constexpr int32_t kAnd = 1, kOr = 2;
inline constexpr float kCoefficients[4][4] = {{1, -1, 0, 0}, {0, 0, 0, 1}, {0, 1, 1, -1}, {0, 1, 0, 0}};

// Φ of all samples: a softmax per group over the logits in `first`, or the true properties.
inline void evaluate_phi(const Net& net, Work& w, int64_t from, int count) {
    const Network& n = *net.shape;
    const int64_t rows = (int64_t)count * w.objects, stride = w.phi_stride;
    for (int v = 0; v < n.words; v++) {
        const int64_t ld = n.detectors ? net.l.columns : n.object_features;
        const float* in = n.detectors ? w.first_of(from, ld) + net.l.detectors + v
                                      : w.x + from * w.objects * ld;
        float* out = w.phi + v * stride + from * w.objects;
        for (int64_t r = 0; r < rows; r++) out[r] = n.detectors ? in[r * ld] : shows(n, v, in + r * ld);
    }
    if (!n.detectors) return;
    for (int64_t r = 0; r < rows; r += W) {
        float* group = w.phi + from * w.objects + r;
        for (int g = 0; g < n.groups; group += n.group_size[g++] * stride) {
            vf most = loadu(group), total{};
            for (int v = 1; v < n.group_size[g]; v++) {
                const vf x = loadu(group + v * stride);
                most = x > most ? x : most;
            }
            for (int v = 0; v < n.group_size[g]; v++) {
                const vf e = exponential(loadu(group + v * stride) - most);
                total += e;
                storeu(group + v * stride, e);
            }
            for (int v = 0; v < n.group_size[g]; v++)
                storeu(group + v * stride, loadu(group + v * stride) / total);
        }
    }
}

// A register of sample s's program k: a row of Φ, HAND, or an instruction's result.
inline const float* register_at(const Work& w, int words, int64_t s, int64_t sk, int r) {
    if (r < words) return w.phi + r * w.phi_stride + s * w.objects;
    if (r == words) return w.hand;
    return w.registers + (sk * w.capacity + r - words - 1) * w.lanes;
}

// Degrees of a set, whose register is `set`, for the objects there are. Only HAND contains the hand.
inline void read_set(const Net& net, const Work& w, int64_t s, int64_t sk, int set, float* out) {
    const float* degree = register_at(w, net.shape->words, s, sk, set);
    for (int i = 0; i < w.objects; i++)
        out[i] = i != w.hand_index || set == net.shape->words ? degree[i] : 0.0f;
}

// p and Σ p of one program (row `program` of the table) on one sample.
inline void run_program(const Net& net, Work& w, int64_t s, int64_t sk, int64_t program) {
    const int words = net.shape->words;
    const int64_t base = program * w.length;
    for (int64_t k = 0; k < w.length; k++) {
        const int32_t op = w.op[base + k];
        const float* c = kCoefficients[op];
        const float* x = register_at(w, words, s, sk, w.a[base + k]);
        const float* y = register_at(w, words, s, sk, w.b[base + k]);
        float* out = w.registers + (sk * w.capacity + k) * w.lanes;
        const bool extreme = net.shape->min_max && (op == kAnd || op == kOr);
        for (int o = 0; o < w.lanes; o += W) {
            const vf u = loadu(x + o), v = loadu(y + o);
            if (extreme) store(out + o, (op == kAnd) ? (u < v ? u : v) : (u > v ? u : v));
            else store(out + o, (c[0] + c[1] * u) + v * (c[2] + c[3] * u));
        }
    }
    const float* last = w.registers + (sk * w.capacity + w.length - 1) * w.lanes;
    float mass = 0.0f;
    for (int i = 0; i < w.lanes; i++) {
        const float p = i < w.objects ? last[i] : 0.0f;
        w.relevant[sk * w.lanes + i] = p;
        mass += p;
    }
    w.mass[sk] = mass;
}

// Adds ∂/∂Φ to the first rows of w.dregister, given ∂/∂p in the last; clears the rows between.
inline void run_program_backward(const Net& net, Work& w, int64_t s, int64_t sk, int64_t program) {
    const int words = net.shape->words;
    const int64_t base = program * w.length;
    for (int64_t k = w.length - 1; k >= 0; k--) {
        const float* c = kCoefficients[w.op[base + k]];
        const int a = w.a[base + k], b = w.b[base + k];
        const float* x = register_at(w, words, s, sk, a);
        const float* y = register_at(w, words, s, sk, b);
        float* out = w.dregister + (words + 1 + k) * w.lanes;
        float *da = w.dregister + (int64_t)a * w.lanes, *db = w.dregister + (int64_t)b * w.lanes;
        for (int o = 0; o < w.lanes; o += W) {
            const vf g = load(out + o), u = loadu(x + o), v = loadu(y + o);
            store(out + o, vf{});
            store(da + o, load(da + o) + g * (c[1] + c[3] * v));
            store(db + o, load(db + o) + g * (c[2] + c[3] * u));
        }
    }
}

// From ∂/∂Φ (w.dregister) to the gradients of the logits, written into `first`.
inline void detectors_backward(const Net& net, Work& w, int64_t s) {
    const Network& n = *net.shape;
    const int64_t stride = w.phi_stride;
    float* out = w.first_of(s, net.l.columns) + net.l.detectors;
    const float* phi = w.phi + s * w.objects;
    float* d = w.dregister;
    for (int g = 0; g < n.groups; g++) {
        const int size = n.group_size[g];
        for (int o = 0; o < w.lanes; o += W) {
            vf mean{};
            for (int v = 0; v < size; v++)
                mean += loadu(phi + v * stride + o) * load(d + v * w.lanes + o);
            for (int v = 0; v < size; v++)
                store(d + v * w.lanes + o,
                      loadu(phi + v * stride + o) * (load(d + v * w.lanes + o) - mean));
        }
        for (int v = 0; v < size; v++)
            for (int i = 0; i < w.objects; i++) out[i * net.l.columns + v] = d[v * w.lanes + i];
        out += size, phi += size * stride, d += size * w.lanes;
    }
}

}  // namespace pa::PA_LEVEL
