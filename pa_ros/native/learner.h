// One DPG update (docs/DESIGN.md, "Learning"; paper, appendix), split over threads by chunks.
#pragma once
#include <initializer_list>

#include "buffer.h"
#include "heads.h"
#include "kernel.h"
#include "network.h"

namespace pa::PA_LEVEL {

// A chunk's rows (samples × programs) go through the second layers together, so that their weights
// are read seldom; a block's (samples × objects) through the first layers, and stay in cache.
inline constexpr int kChunkRows = 64;
inline constexpr int kBlockRows = 80;

struct Thread {
    Work w;
    float *actor_second_t, *critic_second_t;    // `second` transposed
    float *actor_upper_t, *critic_upper_t;      // likewise
    float *actor_gradient, *critic_gradient;    // of this thread's chunks
    float *target_q, *critic_h, *chunk_action;  // [B·K], [B·K, H], [S, 6]
    double squared_error, sum_q, squared_gradient;
};

struct Learner {
    explicit Learner(const LearnerSetup& setup);

    Network actor_shape, critic_shape;
    Tensors actor, critic;
    Settings settings;
    int batch, objects, programs, length, threads, chunk, block;
    Thread thread[kMaxThreads];
    Buffer memory;
};

inline int64_t second_rows(const Layout& l) { return l.parts * l.hidden; }

inline Net net_of(const Network& shape, const float* parameters) {
    return {&shape, layout_of(shape), parameters};
}

// Samples per block and per chunk: blocks are multiples of what a tile has of rows.
inline void choose_chunks(Learner& g) {
    const int per_thread = (g.batch + g.threads - 1) / g.threads;
    const auto samples = [&](int rows, int each) {
        const int most = rows / each / kTileRows * kTileRows, least = kTileRows;
        return most > least ? most : least;
    };
    const int chunk = samples(kChunkRows, g.programs);
    g.chunk = chunk < per_thread ? chunk : per_thread;
    const int block = samples(kBlockRows, g.objects);
    g.block = block < g.chunk ? block : g.chunk;
}

inline int64_t carve_learner(Learner& g, float* base) {
    Arena arena{base, 0};
    const Layout actor = layout_of(g.actor_shape), critic = layout_of(g.critic_shape);
    WorkSize size{g.chunk, g.block, g.objects, g.programs, g.length, g.actor_shape.words,
                  g.actor_shape.object_features, g.actor_shape.arm_features, g.actor_shape.relations,
                  g.actor_shape.roles, g.actor_shape.upper, g.actor_shape.avoids,
                  actor.columns > critic.columns ? actor.columns : critic.columns, actor.hidden,
                  actor.inputs};
    const int64_t square = second_rows(actor) * actor.hidden, rows = (int64_t)g.batch * g.programs;
    for (int t = 0; t < g.threads; t++) {
        Thread scratch, &x = base ? g.thread[t] : scratch;
        carve(x.w, arena, size);
        x.actor_second_t = arena.take(square), x.critic_second_t = arena.take(square);
        const int64_t upper = g.actor_shape.upper * actor.hidden * actor.hidden;
        x.actor_upper_t = arena.take(upper), x.critic_upper_t = arena.take(upper);
        x.actor_gradient = t ? arena.take(actor.size) : g.actor.gradient;
        x.critic_gradient = t ? arena.take(critic.size) : g.critic.gradient;
        x.target_q = arena.take(rows), x.critic_h = arena.take(rows * critic.hidden);
        arena.take(kLane);  // no two threads write one cache line
    }
    return arena.used;
}

inline Learner::Learner(const LearnerSetup& s)
    : actor_shape(s.actor_shape), critic_shape(s.critic_shape), actor(s.actor), critic(s.critic),
      settings(s.settings), batch(s.sizes.transitions), objects(s.sizes.objects),
      programs(s.sizes.programs), length(s.sizes.length), threads(s.sizes.threads), thread{} {
    choose_chunks(*this);
    memory = Buffer(carve_learner(*this, nullptr));
    carve_learner(*this, memory.data());
}

// y = r + discount · Q'(s', π'(s')) of samples [from, from + count).
inline void targets(const Learner& g, Thread& x, const Batch& b, int64_t from, int count) {
    Work& w = x.w;
    const int64_t rows = (int64_t)count * g.programs, base = from * g.programs;
    const Net actor = net_of(g.actor_shape, g.actor.target);
    const Net critic = net_of(g.critic_shape, g.critic.target);
    read_inputs(actor, w, b.next_object, b.next_arm, from, count);
    forward(actor, w, b.program + base, count, false);
    actor_head(actor, w, rows);
    forward(critic, w, b.program + base, count, false);
    critic_head(critic, w, w.h, w.action, kActionColumns, 1, rows);
    for (int64_t r = 0; r < rows; r++)
        x.target_q[base + r] = b.reward[base + r] + b.discount[from + r / g.programs] * w.q[r];
}

inline void critic_step(const Learner& g, Thread& x, const Batch& b, int64_t from, int count) {
    Work& w = x.w;
    const int64_t rows = (int64_t)count * g.programs, base = from * g.programs;
    const Net critic = net_of(g.critic_shape, g.critic.parameters);
    const float* action = b.action + from * critic.shape->actions;
    read_inputs(critic, w, b.object, b.arm, from, count);
    forward(critic, w, b.program + base, count, true);
    const int64_t h = critic.l.hidden;
    __builtin_memcpy(x.critic_h + base * h, w.h, rows * h * sizeof(float));
    critic_head(critic, w, w.h, action, critic.shape->actions, g.programs, rows);
    const float scale = 2.0f / ((float)b.transitions * b.programs);
    for (int64_t r = 0; r < rows; r++) {
        const float error = w.q[r] - x.target_q[base + r];
        x.sum_q += w.q[r], x.squared_error += (double)error * error;
        w.q[r] = scale * error;
    }
    critic_head_backward(critic, w, action, g.programs, rows, x.critic_upper_t, x.critic_gradient);
    backward(critic, w, b.program + base, count, x.critic_second_t, x.critic_gradient);
}

inline void actor_step(const Learner& g, Thread& x, const Batch& b, int64_t from, int count) {
    Work& w = x.w;
    const int64_t rows = (int64_t)count * g.programs, base = from * g.programs;
    const Net actor = net_of(g.actor_shape, g.actor.parameters);
    const Net critic = net_of(g.critic_shape, g.critic.parameters);
    read_inputs(actor, w, b.object, b.arm, from, count);
    forward(actor, w, b.program + base, count, true);
    actor_head(actor, w, rows);
    const int64_t h = actor.l.hidden;
    float *actor_z = w.z, *actor_upper = w.upper;
    w.z = w.dh;  // the critic's tanh is needed only until ∂Q/∂a is known
    w.upper = w.other_upper;
    critic_head(critic, w, x.critic_h + base * h, w.action, kActionColumns, 1, rows);
    const float scale = -1.0f / ((float)b.transitions * b.programs);
    const float clip = (float)g.settings.clip, penalty = (float)g.settings.action_penalty;
    action_gradient(critic, w, rows, x.critic_upper_t, clip, penalty, scale);
    w.z = actor_z, w.upper = actor_upper;
    actor_head_backward(actor, w, rows, x.actor_upper_t, x.actor_gradient);
    backward(actor, w, b.program + base, count, x.actor_second_t, x.actor_gradient);
}

// Gradients of both networks over this thread's part of the batch, at the present parameters.
inline void gradients(Learner& g, const Batch& b, int index) {
    Thread& x = g.thread[index];
    const Layout actor = layout_of(g.actor_shape), critic = layout_of(g.critic_shape);
    const int64_t h = actor.hidden;
    __builtin_memset(x.actor_gradient, 0, actor.size * sizeof(float));
    __builtin_memset(x.critic_gradient, 0, critic.size * sizeof(float));
    transpose(g.actor.parameters + actor.second, second_rows(actor), h, x.actor_second_t);
    transpose(g.critic.parameters + critic.second, second_rows(critic), h, x.critic_second_t);
    transpose_upper(net_of(g.actor_shape, g.actor.parameters), x.actor_upper_t);
    transpose_upper(net_of(g.critic_shape, g.critic.parameters), x.critic_upper_t);
    set_objects(x.w, b.hand_index);
    set_table(x.w, b.table);
    for (int i = 0; i < W; i++) x.w.largest[i] = 0.0f;
    x.squared_error = x.sum_q = x.squared_gradient = 0.0;
    const int64_t part = (b.transitions + g.threads - 1) / g.threads;
    const int64_t begin = index * part, stop = begin + part;
    const int64_t end = stop < b.transitions ? stop : b.transitions;
    for (auto step : {targets, critic_step, actor_step})
        for (int64_t from = begin; from < end; from += g.chunk)
            step(g, x, b, from, (int)(end - from < g.chunk ? end - from : g.chunk));
}

// Weights less `most` · max(0, 1 - |x| · per_size) of their size, but never past zero.
inline vf drawn_to_zero(vf x, float most, float per_size) {
    const vf size = x < 0.0f ? -x : x;
    const vf left = at_least(size - at_least(most * (1.0f - size * per_size), 0.0f), 0.0f);
    return x < 0.0f ? -left : left;
}

// Adam (Kingma & Ba 2015; torch.optim.Adam) on this thread's part of one network's parameters. The
// detectors' steps are `detector_gain` times as long. Then their weights, not their biases, are drawn
// to zero by `sparsity` per unit of rate, and by less the larger they are: not at all from `free_from`
// on (Zhang 2010). Without `prior` nothing is drawn and detectors learn all of their weights.
template <bool prior>
inline double adam(const Learner& g, const Tensors& t, const Layout& l, double rate,
                   const Batch& batch, int index, bool of_actor) {
    const Settings& s = g.settings;
    const int64_t size = l.size, first_end = l.inputs ? 0 : l.first + l.rows * l.columns;
    const float rate_now = (float)(rate / batch.correction1), epsilon = (float)s.epsilon;
    const float root = (float)(1.0 / __builtin_sqrt(batch.correction2));
    const float keep1 = (float)s.beta1, take1 = (float)(1.0 - s.beta1);
    const float keep2 = (float)s.beta2, take2 = (float)(1.0 - s.beta2);
    const int64_t biases = l.first + (l.rows - 1) * l.columns;  // of the first layers
    // What detectors do not learn: rows of the arm, biases, or both.
    const int64_t arm = l.first + g.actor_shape.object_features * l.columns;
    [[maybe_unused]] const int64_t kept = s.detector_arm ? biases : arm;
    [[maybe_unused]] const int64_t kept_end = s.detector_bias ? biases : first_end;
    const float gain = (float)s.detector_gain;
    [[maybe_unused]] const float drawn = (float)(rate * s.detector_gain * s.sparsity);
    [[maybe_unused]] const float per_size = (float)(1.0 / s.free_from);
    const int64_t part = padded((size + g.threads - 1) / g.threads), begin = index * part;
    const int64_t end = begin + part < size ? begin + part : size;
    vf squares{};
    for (int64_t i = begin; i < end; i += W) {
        vf d = load(t.gradient + i);
        for (int k = 1; k < g.threads; k++)
            d += load((of_actor ? g.thread[k].actor_gradient : g.thread[k].critic_gradient) + i);
        if (g.threads > 1) store(t.gradient + i, d);
        const bool detects = i < first_end && (i - l.first) % l.columns >= l.detectors;
        if constexpr (prior)
            if (detects && i >= kept && i < kept_end) store(t.gradient + i, d = vf{});
        squares += d * d;
        const vf m = keep1 * load(t.first_moment + i) + take1 * d;
        const vf v = keep2 * load(t.second_moment + i) + take2 * d * d;
        store(t.first_moment + i, m);
        store(t.second_moment + i, v);
        const float length = detects ? gain * rate_now : rate_now;
        const vf x = load(t.parameters + i) - length * m / (square_root(v) * root + epsilon);
        const bool weighs = detects && i < biases;
        store(t.parameters + i, prior && weighs ? drawn_to_zero(x, drawn, per_size) : x);
    }
    float sum[W];
    sum_lanes(&squares, 1, sum);
    return sum[0];
}

// Steps of Adam of both networks; call when every thread's gradients are there.
inline void apply(Learner& g, const Batch& batch, int index) {
    const Layout actor = layout_of(g.actor_shape), critic = layout_of(g.critic_shape);
    const Settings& s = g.settings;
    const bool all = s.detector_arm && s.detector_bias;
    const auto step = s.sparsity > 0 || !all ? adam<true> : adam<false>;
    const double share = batch.rate_share;
    step(g, g.critic, critic, share * s.critic_rate, batch, index, false);
    g.thread[index].squared_gradient =
        step(g, g.actor, actor, share * s.actor_rate, batch, index, true);
}

inline Metrics metrics(const Learner& g, const Batch& batch) {
    double error = 0, q = 0, gradient = 0, largest = 0;
    for (int t = 0; t < g.threads; t++) {
        const Thread& x = g.thread[t];
        error += x.squared_error, q += x.sum_q, gradient += x.squared_gradient;
        for (int i = 0; i < W; i++) largest = x.w.largest[i] > largest ? x.w.largest[i] : largest;
    }
    const double rows = (double)batch.transitions * batch.programs;
    return {error / rows, q / rows, __builtin_sqrt(gradient), largest};
}

}  // namespace pa::PA_LEVEL
