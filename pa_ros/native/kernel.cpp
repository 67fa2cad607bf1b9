// The update for one instruction-set level: compiled once per level, with PA_LEVEL its name.
#include <cstdlib>
#include <cstring>
#include <initializer_list>
#if defined(__x86_64__)
#include <immintrin.h>
#endif

#include "kernel.h"
#include "layout.h"

namespace pa {
namespace PA_LEVEL {
namespace {

#include "simd.h"
#include "gemm.h"
#include "work.h"
#include "program.h"
#include "trunk.h"
#include "trunk_backward.h"
#include "mlp.h"
#include "heads.h"
#include "learner.h"

// Subnormal numbers count as zero while we compute: they would only cost time.
struct FlushSubnormals {
#if defined(__x86_64__)
    unsigned int before = _mm_getcsr();
    FlushSubnormals() { _mm_setcsr(before | 0x8040); }
    ~FlushSubnormals() { _mm_setcsr(before); }
#endif
};

void* zeroed(int64_t bytes) {
    void* at = std::aligned_alloc(64, (size_t)(bytes + 63) / 64 * 64);
    return at ? std::memset(at, 0, (size_t)bytes) : nullptr;
}

void destroy(void* learner) {
    auto* g = static_cast<Learner*>(learner);
    if (!g) return;
    std::free(g->memory), std::free(g->thread), std::free(g);
}

void* create(const Network* actor, const Network* critic, const Tensors* actor_tensors,
             const Tensors* critic_tensors, const Settings* settings, const Sizes* z) {
    auto* g = static_cast<Learner*>(std::calloc(1, sizeof(Learner)));
    if (!g) return nullptr;
    g->actor_shape = *actor, g->critic_shape = *critic, g->settings = settings;
    g->actor = *actor_tensors, g->critic = *critic_tensors;
    g->batch = z->transitions, g->objects = z->objects, g->programs = z->programs;
    g->length = z->length, g->threads = z->threads;
    choose_chunks(*g);
    g->thread = static_cast<Thread*>(std::calloc((size_t)z->threads, sizeof(Thread)));
    g->memory = zeroed(carve_learner(*g, nullptr));
    if (!g->thread || !g->memory) return destroy(g), nullptr;
    carve_learner(*g, static_cast<char*>(g->memory));
    return g;
}

void compute_gradients(void* learner, const Batch* batch, int index) {
    const FlushSubnormals flush;
    gradients(*static_cast<Learner*>(learner), *batch, index);
}

void apply_gradients(void* learner, int64_t actor_step, int64_t critic_step, int index) {
    const FlushSubnormals flush;
    apply(*static_cast<Learner*>(learner), actor_step, critic_step, index);
}

void read_metrics(const void* learner, const Batch* batch, Metrics* out) {
    const auto& g = *static_cast<const Learner*>(learner);
    double error = 0, q = 0, gradient = 0, largest = 0;
    for (int t = 0; t < g.threads; t++) {
        const Thread& x = g.thread[t];
        error += x.squared_error, q += x.sum_q, gradient += x.squared_gradient;
        for (int i = 0; i < W; i++) largest = x.w.largest[i] > largest ? x.w.largest[i] : largest;
    }
    const double rows = (double)batch->transitions * batch->programs;
    *out = {error / rows, q / rows, __builtin_sqrt(gradient), largest};
}

struct Actor {
    Network shape;
    const float* parameters;
    Work w;
    void* memory;
};

void destroy_actor(void* actor) {
    auto* x = static_cast<Actor*>(actor);
    if (!x) return;
    std::free(x->memory), std::free(x);
}

void* create_actor(const Network* shape, const float* parameters, int objects, int length) {
    auto* x = static_cast<Actor*>(std::calloc(1, sizeof(Actor)));
    if (!x) return nullptr;
    const Layout l = layout_of(*shape);
    const WorkSize size{1, 1, objects, 1, length, shape->words, l.columns, l.hidden, l.inputs};
    x->shape = *shape, x->parameters = parameters;
    Arena arena{nullptr, 0};
    carve(x->w, arena, size);
    x->memory = zeroed(arena.used);
    if (!x->memory) return destroy_actor(x), nullptr;
    arena = {static_cast<char*>(x->memory), 0};
    carve(x->w, arena, size);
    return x;
}

void run_actor(void* actor, const float* objects, const float* arm, int hand_index,
               const int32_t* op, const int32_t* a, const int32_t* b, int length, float* action) {
    const FlushSubnormals flush;
    auto* x = static_cast<Actor*>(actor);
    x->w.op = op, x->w.a = a, x->w.b = b, x->w.length = length;
    act(x->shape, x->parameters, x->w, objects, arm, hand_index, action);
}

template <class F>
void map(const float* x, const float* y, float* out, int64_t size, F f) {
    for (int64_t i = 0; i < size; i += W) storeu(out + i, f(loadu(x + i), loadu(y + i)));
}

// The building blocks alone, to be tested and timed: 0 e^x, 1 tanh x, 2 tanh(a + b) where
// x = e^2a / 2 and y = e^2b. Size is a multiple of kLane.
void elementwise(int kind, const float* x, const float* y, float* out, int64_t size,
                 int64_t repeats) {
    for (; repeats > 1; repeats--) elementwise(kind, x, y, out, size, 1);
    if (kind == 0) map(x, y, out, size, [](vf a, vf) { return exponential(a); });
    if (kind == 1) map(x, y, out, size, [](vf a, vf) { return tanh_of(a); });
    if (kind == 2) map(x, y, out, size, [](vf a, vf b) { return tanh_of_sum(a, b); });
}

void product(int64_t rows, int64_t columns, int64_t depth, const float* a, const float* b,
             float* c) {
    multiply(rows, columns, depth, {a, depth, 1}, b, columns, c, columns, FromZero{});
}

}  // namespace

extern const Kernel kernel;
const Kernel kernel = {create,       destroy,       compute_gradients, apply_gradients,
                       read_metrics, create_actor,  destroy_actor,     run_actor,
                       elementwise,  product};

}  // namespace PA_LEVEL
}  // namespace pa
