// What each instruction-set level offers to the engine, and the plain types that pass between them.
// The engine has checked all of it: sizes, rows and registers are in range.
#pragma once
#include <cstdint>

#include "layout.h"

namespace pa {

// Buffers of one trained network, each Layout::size floats, 64-byte aligned.
struct Tensors {
    float *parameters, *target, *gradient, *first_moment, *second_moment;
};

struct Settings {  // of a learner for as long as it lives
    double actor_rate, critic_rate, beta1, beta2, epsilon, clip, action_penalty, detector_gain;
    double sparsity, free_from;  // of the detectors' weights; see `adam` in learner.h
    bool detector_arm;           // whether detectors see the arm's features
    bool detector_bias;          // whether it is learned
};

enum Set { kMoved, kTarget, kAvoided, kSets };  // of a program: what is moved, where to, what is avoided

// Programs, rows of `length` instructions; for canonical networks rows of a word of each group.
struct Table {
    int32_t length;
    const int32_t *op, *a, *b;
    const int32_t* relation;     // of each program; read where a network knows several
    const int32_t* sets[kSets];  // the register of each set of each program
    const int32_t* words;        // of canonical networks instead
};

// B transitions of N objects × K programs, which are rows of the table (see docs/DESIGN.md).
struct Batch {
    int32_t transitions, objects, programs, hand_index;
    const float *object, *arm, *action, *next_object, *next_arm;
    const int32_t* program;
    const float *reward, *discount;
    double correction1, correction2;  // of Adam's moments, 1 - beta^step
    double rate_share = 1.0;          // of both learning rates
    Table table;
};

struct Observation {
    int32_t objects, hand_index;
    const float *object, *arm;
};

// `largest_part`: of the sums x + y under tanh, the largest |x| or |y|. Beyond kLargestPart a part
// is clamped, so a sum of two such parts of opposite sign is wrong (see simd.h).
struct Metrics {
    double critic_loss, mean_q, actor_gradient_norm, largest_part;
};

struct Sizes {  // the most of each that a learner will be given; objects and programs exactly
    int32_t transitions, objects, programs, length, threads;
};

struct LearnerSetup {  // the tensors outlive the learner
    Network actor_shape, critic_shape;
    Tensors actor, critic;
    Settings settings;
    Sizes sizes;
};

// Each part of an update may run on a thread of its own: first every part's gradients, then every
// part's steps.
class LearnerKernel {
  public:
    virtual ~LearnerKernel();
    virtual void gradients(const Batch& batch, int part) = 0;
    virtual void apply(const Batch& batch, int part) = 0;
    virtual Metrics metrics(const Batch& batch) const = 0;
};

class ActorKernel {
  public:
    virtual ~ActorKernel();
    virtual void act(const Observation& seen, const Table& program, float* action) = 0;
    // p, then the degrees of each set of the program, [1 + kSets, N]: what `act` begins with.
    virtual void degrees(const Observation& seen, const Table& program, float* degrees) = 0;
};

enum class Function : int32_t { exponential, tanh, tanh_of_sum };

struct Kernel {  // what is made belongs to the caller
    LearnerKernel* (*make_learner)(const LearnerSetup& setup);
    ActorKernel* (*make_actor)(const Network& shape, const float* parameters, int objects,
                               int length);
    void (*elementwise)(Function function, const float* x, const float* y, float* out, int64_t size,
                        int64_t repeats);
    void (*product)(int64_t rows, int64_t columns, int64_t depth, const float* a, const float* b,
                    float* c);
};

}  // namespace pa
