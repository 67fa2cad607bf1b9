// What each instruction-set level offers to the library's entry points.
#pragma once
#include "layout.h"

namespace pa {

struct Sizes {  // the most of each that a learner will be given
    int32_t transitions, objects, programs, length, threads;
};

struct Kernel {
    void* (*create)(const Network*, const Network*, const Tensors*, const Tensors*,
                    const Settings*, const Sizes*);
    void (*destroy)(void*);
    void (*gradients)(void*, const Batch*, int thread);
    void (*apply)(void*, int64_t actor_step, int64_t critic_step, int thread);
    void (*metrics)(const void*, const Batch*, Metrics*);
    void* (*create_actor)(const Network*, const float* parameters, int objects, int length);
    void (*destroy_actor)(void*);
    void (*act)(void*, const float* objects, const float* arm, int hand_index, const int32_t* op,
                const int32_t* a, const int32_t* b, int length, float* action);
    void (*elementwise)(int kind, const float* x, const float* y, float* out, int64_t size,
                        int64_t repeats);
    void (*product)(int64_t rows, int64_t columns, int64_t depth, const float* a, const float* b,
                    float* c);
};

}  // namespace pa
