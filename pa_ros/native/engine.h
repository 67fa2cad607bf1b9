// The fused update and the actor, for whoever calls them: they own their memory and check what
// they are given. Calls on one object take turns.
#pragma once
#include <cstdint>
#include <memory>
#include <mutex>
#include <vector>

#include "buffer.h"
#include "kernel.h"
#include "levels.h"
#include "team.h"

namespace pa {

// One network: parameters, target, gradient and Adam's moments, each a flat buffer; zero at first.
struct Trained {
    explicit Trained(const Network& network);
    Tensors tensors() const;

    Network shape;
    Layout layout;
    Buffer parameters, target, gradient, first_moment, second_moment;
};

// Programs as the caller has them: `op`, `a` and `b` are [rows, length], `relation` and each of `sets`
// [rows].
struct Programs {
    int64_t rows, length;
    const int32_t *op, *a, *b, *relation, *sets[kSets];
};

struct Targets {  // a word of each group, [rows, groups]
    int64_t rows;
    const int32_t* words;
};

// Error unless every instruction reads words, the hand or what came before it.
void check(const Programs& programs, const Network& network);
void check(const Targets& targets, const Network& network);

// Programs or targets of one network, copied.
class OwnTable {
  public:
    void copy(const Programs& programs, const Network& network);
    void copy(const Targets& targets, const Network& network);
    Table table() const;

    int64_t rows = 0, length = 1;

  private:
    std::vector<int32_t> op_, a_, b_, relation_, sets_[kSets], words_;
};

class Engine {
  public:
    Engine(const Network& actor, const Network& critic, const Settings& settings, int threads,
           const Level& used = level());

    Trained& actor() { return actor_; }
    Trained& critic() { return critic_; }

    // What the programs of the next batches are rows of, in place of what was.
    void set_programs(const Programs& programs);
    void set_targets(const Targets& targets);

    // One update of both networks; the batch's table is the engine's.
    Metrics update(Batch batch);

  private:
    void check(const Batch& batch) const;
    void fit(const Batch& batch);

    Trained actor_, critic_;
    const Settings settings_;
    const Kernel* kernel_;
    OwnTable table_;
    Sizes sizes_{};
    std::unique_ptr<LearnerKernel> learner_;
    Team team_;
    std::mutex turn_;
};

class Actor {
  public:
    explicit Actor(const Network& network, const Level& used = level());

    const Network& shape() const { return shape_; }
    Buffer& parameters() { return parameters_; }

    // What is acted on from now on: one program, or for canonical networks one target.
    void set_program(const Programs& program);
    void set_target(const Targets& target);

    void act(const Observation& seen, float* action);     // [J]
    void degrees(const Observation& seen, float* degrees);  // [1 + kSets, N]: see ActorKernel

  private:
    ActorKernel& kernel_for(const Observation& seen);

    const Network shape_;
    const Kernel* kernel_;
    Buffer parameters_;
    OwnTable table_;
    struct Sized {
        int64_t length = 0;  // the longest program that fits
        std::unique_ptr<ActorKernel> kernel;
    };
    std::vector<Sized> sized_;  // by the number of objects
    std::mutex turn_;
};

}  // namespace pa
