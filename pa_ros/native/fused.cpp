// Entry points of the library, for ctypes (pa_ros/native/library.py); picks the widest
// instruction set of those it was built for that this machine has.
#include <cstdlib>
#include <cstring>
#include <new>

#include "kernel.h"
#include "team.h"

namespace pa {

#if defined(__x86_64__)
namespace v4 {
extern const Kernel kernel;
}
namespace v3 {
extern const Kernel kernel;
}
#endif
namespace generic {
extern const Kernel kernel;
}

namespace {

struct Level {
    const char* name;
    const Kernel* kernel;
};

// PA_ROS_FUSED_LEVEL (x86-64-v4, x86-64-v3, generic) asks for a lower level than the widest.
Level choose_level() {
    const char* wanted = std::getenv("PA_ROS_FUSED_LEVEL");
    const auto allowed = [&](const char* name) {
        return !wanted || !*wanted || !std::strcmp(wanted, name);
    };
#if defined(__x86_64__)
    __builtin_cpu_init();
    const bool v3 = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
    const bool v4 = v3 && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
                    __builtin_cpu_supports("avx512cd") && __builtin_cpu_supports("avx512dq") &&
                    __builtin_cpu_supports("avx512vl");
    if (v4 && allowed("x86-64-v4")) return {"x86-64-v4", &v4::kernel};
    if (v3 && allowed("x86-64-v3")) return {"x86-64-v3", &v3::kernel};
#endif
    (void)allowed;
    return {"generic", &generic::kernel};
}

const Level& level() {
    static const Level chosen = choose_level();
    return chosen;
}

struct Handle {
    const Kernel* kernel;
    void* learner;
    Team team;
    Handle(const Kernel* k, void* l, int threads) : kernel(k), learner(l), team(threads) {}
    ~Handle() { kernel->destroy(learner); }
};

struct ActorHandle {
    const Kernel* kernel;
    void* actor;
};

}  // namespace
}  // namespace pa

extern "C" {

int32_t pa_fused_interface() { return pa::kInterface; }

const char* pa_fused_level() { return pa::level().name; }

void pa_fused_layout(const pa::Network* network, pa::Layout* out) {
    *out = pa::layout_of(*network);
}

// A learner on the caller's buffers and settings, which must outlive it; null if there is no memory.
void* pa_fused_create(const pa::Network* actor, const pa::Network* critic,
                      const pa::Tensors* actor_tensors, const pa::Tensors* critic_tensors,
                      const pa::Settings* settings, const pa::Sizes* sizes) {
    const pa::Kernel* k = pa::level().kernel;
    void* learner = k->create(actor, critic, actor_tensors, critic_tensors, settings, sizes);
    if (!learner) return nullptr;
    try {
        return new pa::Handle(k, learner, sizes->threads);
    } catch (...) {
        k->destroy(learner);
        return nullptr;
    }
}

void pa_fused_destroy(void* handle) { delete static_cast<pa::Handle*>(handle); }

// One update; the steps are Adam's, 1 for the first. Sizes are within those of pa_fused_create,
// objects and programs equal to them, table rows and registers in range: the caller checks.
void pa_fused_update(void* handle, const pa::Batch* batch, int64_t actor_step, int64_t critic_step,
                     pa::Metrics* metrics) {
    auto& h = *static_cast<pa::Handle*>(handle);
    auto gradients = [&](int i) { h.kernel->gradients(h.learner, batch, i); };
    auto apply = [&](int i) { h.kernel->apply(h.learner, actor_step, critic_step, i); };
    h.team.run(gradients);
    h.team.run(apply);
    h.kernel->metrics(h.learner, batch, metrics);
}

// An actor on the caller's parameters, for observations of `objects` objects.
void* pa_fused_actor_create(const pa::Network* network, const float* parameters, int32_t objects,
                            int32_t length) {
    const pa::Kernel* k = pa::level().kernel;
    void* actor = k->create_actor(network, parameters, objects, length);
    if (!actor) return nullptr;
    auto* handle = new (std::nothrow) pa::ActorHandle{k, actor};
    if (!handle) k->destroy_actor(actor);
    return handle;
}

void pa_fused_actor_destroy(void* handle) {
    auto* h = static_cast<pa::ActorHandle*>(handle);
    if (!h) return;
    h->kernel->destroy_actor(h->actor);
    delete h;
}

void pa_fused_act(void* handle, const float* objects, const float* arm, int32_t hand_index,
                  const int32_t* op, const int32_t* a, const int32_t* b, int32_t length,
                  float* action) {
    const auto* h = static_cast<pa::ActorHandle*>(handle);
    h->kernel->act(h->actor, objects, arm, hand_index, op, a, b, length, action);
}

// out = f(x, y) of `size` floats, by kind: see kernel.cpp. Size is a multiple of 16. `repeats` times,
// so that short arrays can be timed.
void pa_fused_elementwise(int32_t kind, const float* x, const float* y, float* out, int64_t size,
                          int64_t repeats) {
    pa::level().kernel->elementwise(kind, x, y, out, size, repeats);
}

// c [rows, columns] = a [rows, depth] · b [depth, columns], row-major; b and c are 64-byte aligned
// and columns a multiple of 16.
void pa_fused_product(int64_t rows, int64_t columns, int64_t depth, const float* a, const float* b,
                      float* c) {
    pa::level().kernel->product(rows, columns, depth, a, b, c);
}

}  // extern "C"
