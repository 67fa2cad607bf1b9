// The update for one instruction-set level: compiled once per level, with PA_LEVEL its name.
#include "kernel.h"

#if defined(__x86_64__)
#include <immintrin.h>
#endif

#include "learner.h"

namespace pa::PA_LEVEL {
namespace {

// Subnormal numbers count as zero while we compute: they would only cost time.
struct FlushSubnormals {
#if defined(__x86_64__)
    unsigned int before = _mm_getcsr();
    FlushSubnormals() { _mm_setcsr(before | 0x8040); }
    ~FlushSubnormals() { _mm_setcsr(before); }
#endif
};

class Update final : public LearnerKernel {
  public:
    explicit Update(const LearnerSetup& setup) : learner_(setup) {}

    void gradients(const Batch& batch, int part) override {
        const FlushSubnormals flush;
        PA_LEVEL::gradients(learner_, batch, part);
    }

    void apply(const Batch& batch, int part) override {
        const FlushSubnormals flush;
        PA_LEVEL::apply(learner_, batch, part);
    }

    Metrics metrics(const Batch& batch) const override {
        return PA_LEVEL::metrics(learner_, batch);
    }

  private:
    Learner learner_;
};

class Act final : public ActorKernel {
  public:
    Act(const Act&) = delete;
    Act(const Network& shape, const float* parameters, int objects, int length)
        : net_{&shape_, layout_of(shape), parameters}, shape_(shape) {
        const Layout& l = net_.l;
        const WorkSize size{1, 1, objects, 1, length, shape.words, shape.object_features,
                            shape.arm_features, shape.relations, shape.roles, shape.upper,
                            shape.avoids, l.columns, l.hidden, l.inputs};
        Arena arena{nullptr, 0};
        carve(work_, arena, size);
        memory_ = Buffer(arena.used);
        arena = {memory_.data(), 0};
        carve(work_, arena, size);
    }

    void act(const Observation& seen, const Table& program, float* action) override {
        const FlushSubnormals flush;
        const int32_t row = 0;
        begin(seen, program);
        forward(net_, work_, &row, 1, false);
        actor_head(net_, work_, 1);
        for (int i = 0; i < shape_.actions; i++) action[i] = work_.action[i];
    }

    void degrees(const Observation& seen, const Table& program, float* degrees) override {
        const FlushSubnormals flush;
        begin(seen, program);
        relevance_forward(net_, work_);
        const int n = seen.objects, last = shape_.words + (int)program.length;
        for (int i = 0; i < n; i++) degrees[i] = register_at(work_, shape_.words, 0, 0, last)[i];
        for (int set = 0; set < kSets; set++)
            read_set(net_, work_, 0, 0, program.sets[set][0], degrees + (1 + set) * n);
    }

  private:
    void begin(const Observation& seen, const Table& program) {
        set_table(work_, program);
        set_objects(work_, seen.hand_index);
        read_inputs(net_, work_, seen.object, seen.arm, 0, 1);
    }

    Net net_;
    Network shape_;
    Work work_{};
    Buffer memory_;
};

LearnerKernel* make_learner(const LearnerSetup& setup) { return new Update(setup); }

ActorKernel* make_actor(const Network& shape, const float* parameters, int objects, int length) {
    return new Act(shape, parameters, objects, length);
}

template <class F>
void map(const float* x, const float* y, float* out, int64_t size, F f) {
    for (int64_t i = 0; i < size; i += W) storeu(out + i, f(loadu(x + i), loadu(y + i)));
}

// The building blocks alone, to be tested and timed: tanh_of_sum is tanh(a + b) where x = e^2a / 2
// and y = e^2b. Size is a multiple of kLane.
void elementwise(Function function, const float* x, const float* y, float* out, int64_t size,
                 int64_t repeats) {
    for (; repeats > 0; repeats--) switch (function) {
            case Function::exponential:
                map(x, y, out, size, [](vf a, vf) { return exponential(a); });
                break;
            case Function::tanh:
                map(x, y, out, size, [](vf a, vf) { return tanh_of(a); });
                break;
            case Function::tanh_of_sum:
                map(x, y, out, size, [](vf a, vf b) { return tanh_of_sum(a, b); });
        }
}

void product(int64_t rows, int64_t columns, int64_t depth, const float* a, const float* b,
             float* c) {
    multiply(rows, columns, depth, {a, depth, 1}, b, columns, c, columns, FromZero{});
}

}  // namespace

extern const Kernel kernel;
const Kernel kernel = {make_learner, make_actor, elementwise, product};

}  // namespace pa::PA_LEVEL
