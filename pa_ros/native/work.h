// Scratch memory of one thread: a chunk of S samples of N objects with K programs each.
#pragma once
#if defined(__SANITIZE_ADDRESS__)
#include <sanitizer/asan_interface.h>
#endif

#include "kernel.h"
#include "simd.h"

namespace pa::PA_LEVEL {

struct Arena {  // one block, handed out in lines of kLane floats; `base` null: only measures
    float* base;
    int64_t used;
    float* take(int64_t floats) {
        float* at = base ? base + used : nullptr;
        used += padded(floats);
#if defined(__SANITIZE_ADDRESS__)  // nobody may touch the line between two parts
        if (base) __asan_poison_memory_region(base + used, kLane * sizeof(float));
        used += kLane;
#endif
        return at;
    }
};

struct Work {
    int samples, objects, lanes, programs;  // S, N, N padded, K
    int block, ring;  // samples per block; samples that `first` holds, in turn
    int64_t phi_stride;

    float *x, *arm;          // inputs: scaled objects [S·N, F]; arm and a 1 [S, A + 1]
    float* first;            // [S·N, columns]: activations; the backward pass leaves gradients here
    float* first_arm;        // [S, columns]: the arm's share; then the gradients summed over objects
    float* phi;              // [V, phi_stride]: Φ of all samples side by side
    float* registers;        // [S·K, L, lanes]: results of the program's instructions
    float* relevant;         // [S·K, lanes]: p
    float* mass;             // [S·K]: Σ p
    float* senders;          // roles: [S·K, lanes]: p2
    float *moved, *drole;    // roles: [S·K, lanes]: p1; [2, lanes]: ∂/∂ p1 and p2
    float *avoided, *davoided;  // [S·K, lanes]: p_avoid; [K, N]: its gradient, of one sample
    float* attend;           // [S, N(j), lanes(i)]: exp α̃_ij
    float* share;            // [S·K, N(j), lanes(i)]: exp α̃_ij / Σ_k p_k exp α̃_ik
    float* weight;           // [S·K, N(j), lanes(i)]: p_i α_ij
    float *pooled, *dpooled; // [S·K, 2H]: Σ p_i tanh f0_i, Σ p_i α_ij tanh r0_ij; third: Σ p_avoid_i tanh a0_i
    float *h, *dh, *z;       // [S·K, H]
    float *action, *daction; // [S·K, 16]
    float* q;                // [S·K]
    float *upper, *other_upper;   // [U, S·K, H]: tanh of each upper layer, of actor and critic
    float *dlift, *dlift_before;  // [S·K, H]: gradients on the way down these layers
    float *sums, *dregister, *dscore, *row;  // of one sample
    vf* dots;                // [K, N² + N + 1] or [N²]
    float *hand, *mask;      // [lanes]: HAND; 1 for the objects there are
    float* factor;           // [R, H]: e^2e of what each relation adds
    float* largest;          // [W]: largest |x| that met in pairs since it was set to 0

    int hand_index;
    const int32_t *op, *a, *b;  // the program table, rows of `length`
    const int32_t* relation;    // of each program
    const int32_t* sets[kSets]; // the register of each set of each program
    const int32_t* words;       // of canonical networks instead: rows of a word of each group
    int64_t length, capacity;   // instructions a program has now, and at most

    float* first_of(int64_t s, int64_t columns) const {
        return first + s % ring * objects * columns;
    }
    int64_t dots_per_program() const { return (int64_t)objects * objects + objects + 1; }
};

struct WorkSize {
    int samples, block, objects, programs, length, words, object_features, arm_features, relations, roles, upper, avoids;
    int64_t columns, hidden, inputs;  // inputs: 0 unless canonical
};

// What every network needs, with w.samples and so on.
inline void carve_heads(Work& w, Arena& arena, const WorkSize& z) {
    const int64_t lanes = padded(z.objects), sk = (int64_t)z.samples * z.programs;
    w.samples = z.samples, w.objects = z.objects, w.programs = z.programs, w.lanes = (int)lanes;
    w.capacity = z.length, w.block = z.block;
    w.h = arena.take(sk * z.hidden), w.dh = arena.take(sk * z.hidden), w.z = arena.take(sk * z.hidden);
    w.action = arena.take(sk * kActionColumns), w.daction = arena.take(sk * kActionColumns);
    w.q = arena.take(sk);
    const int64_t lifted = z.upper ? sk * z.hidden : 0;
    w.upper = arena.take(z.upper * lifted), w.other_upper = arena.take(z.upper * lifted);
    w.dlift = arena.take(lifted), w.dlift_before = arena.take(lifted);
    w.hand = arena.take(lanes), w.mask = arena.take(lanes), w.largest = arena.take(W);
}

// For canonical networks: x [S, inputs]; first and dpooled [S·K, H]; first_arm [S, H].
inline void carve_mlp(Work& w, Arena& arena, const WorkSize& z) {
    const int64_t s = z.samples, rows = s * z.programs * z.hidden;
    carve_heads(w, arena, z);
    w.x = arena.take(s * padded(z.inputs)), w.first_arm = arena.take(s * z.hidden);
    w.first = arena.take(rows), w.dpooled = arena.take(rows);
}

inline void carve(Work& w, Arena& arena, const WorkSize& z) {
    if (z.inputs) return carve_mlp(w, arena, z);
    const int64_t s = z.samples, n = z.objects, k = z.programs, lanes = padded(n), sk = s * k;
    carve_heads(w, arena, z);
    w.phi_stride = padded(s * n) + lanes;
    w.x = arena.take(s * n * z.object_features), w.arm = arena.take(s * (z.arm_features + 1));
    w.first = arena.take(s * n * z.columns), w.first_arm = arena.take(s * z.columns);
    w.phi = arena.take(z.words * w.phi_stride);
    w.registers = arena.take(sk * z.length * lanes);
    w.relevant = arena.take(sk * lanes), w.mass = arena.take(sk);
    w.senders = arena.take(z.roles * sk * lanes);
    w.moved = arena.take(z.roles * sk * lanes), w.drole = arena.take(z.roles * 2 * lanes);
    w.avoided = arena.take(z.avoids * sk * lanes), w.davoided = arena.take(z.avoids * (k * n + 2 * lanes));
    w.attend = arena.take(s * n * lanes);
    w.share = arena.take(sk * n * lanes), w.weight = arena.take(sk * n * lanes);
    const int64_t parts = 2 + z.avoids;
    w.pooled = arena.take(sk * parts * z.hidden), w.dpooled = arena.take(sk * parts * z.hidden);
    const int64_t dots = k * (n * n + n + 1);
    w.sums = arena.take(dots + 2 * lanes), w.dots = (vf*)arena.take((dots + n) * W);
    w.dregister = arena.take((z.words + 1 + z.length) * lanes);
    w.dscore = arena.take(n * lanes), w.row = arena.take(z.hidden);
    w.factor = arena.take(z.relations * z.hidden);
}

inline void set_objects(Work& w, int hand_index) {
    w.hand_index = hand_index;
    for (int i = 0; i < w.lanes; i++) w.hand[i] = i == hand_index, w.mask[i] = i < w.objects;
}

inline void set_table(Work& w, const Table& table) {
    w.op = table.op, w.a = table.a, w.b = table.b, w.length = table.length;
    w.relation = table.relation, w.words = table.words;
    for (int set = 0; set < kSets; set++) w.sets[set] = table.sets[set];
}

// Whether a word is true of an object whose features, scaled, are x.
inline bool shows(const Network& n, int word, const float* x) {
    const Word& value = n.word[word];
    float square = 0.0f;
    for (int i = 0; i < value.width; i++) {
        const float d = x[value.at + i] - n.number[value.numbers + i];
        square += d * d;
    }
    return value.width && square <= value.square;
}

struct Net {  // a network's description, layout and current parameters
    const Network* shape;
    Layout l;
    const float* p;
};

}  // namespace pa::PA_LEVEL
