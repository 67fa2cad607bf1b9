#include "engine.h"

#include <algorithm>
#include <string>

#include "error.h"

namespace pa {

namespace {

constexpr int kOperations = 4;

const Network& checked(const Network& network) {
    check(network);
    return network;
}

// Both networks share scratch memory and programs.
void check_pair(const Network& actor, const Network& critic) {
    if (actor.critic || !critic.critic) throw Error("expected an actor, then a critic");
    if (actor.min_max || critic.min_max)
        throw Error("expected networks whose AND and OR can be differentiated, got min and max");
    check_range("critic's kind", critic.canonical, actor.canonical, actor.canonical);
    check_range("critic's hidden", critic.hidden, actor.hidden, actor.hidden);
    check_range("critic's attention", critic.attention, actor.attention, actor.attention);
    check_range("critic's relations", critic.relations, actor.relations, actor.relations);
    check_range("critic's roles", critic.roles, actor.roles, actor.roles);
    check_range("critic's avoids", critic.avoids, actor.avoids, actor.avoids);
    check_range("critic's upper layers", critic.upper, actor.upper, actor.upper);
    check_range("critic's words", critic.words, actor.words, actor.words);
    check_range("critic's groups", critic.groups, actor.groups, actor.groups);
    check_range("critic's actions", critic.actions, actor.actions, actor.actions);
    check_range("features of the critic's objects", critic.object_features, actor.object_features,
                actor.object_features);
    check_range("features of the critic's arm", critic.arm_features, actor.arm_features,
                actor.arm_features);
    check_range("critic's slots", critic.slots, actor.slots, actor.slots);
}

void check_kind(bool expected, const char* what) {
    if (!expected) throw Error(std::string("not told of ") + what + " by networks of this kind");
}

void check_scene(int64_t objects, int64_t hand_index) {
    check_range("objects", objects, 1, kMaxObjects);
    check_range("hand_index", hand_index, 0, objects - 1);
}

int check_threads(int threads) {
    check_range("threads", threads, 1, kMaxThreads);
    return threads;
}

}  // namespace

void check(const Programs& p, const Network& network) {
    check_kind(!network.canonical, "programs");
    check_range("programs of a table", p.rows, 0, INT32_MAX);
    check_range("length of a program", p.length, 1, kMaxLength);
    for (int64_t row = 0; row < p.rows; row++)
        for (int64_t k = 0; k < p.length; k++) {
            const int64_t i = row * p.length + k, last = network.words + k;
            check_range("op of a program", p.op[i], 0, kOperations - 1);
            check_range("register a of a program", p.a[i], 0, last);
            check_range("register b of a program", p.b[i], 0, last);
        }
    for (int64_t row = 0; network.relations && row < p.rows; row++)
        check_range("relation of a program", p.relation[row], 0, network.relations - 1);
    for (const int32_t* set : p.sets)
        for (int64_t row = 0; row < p.rows; row++)
            check_range("register of a set", set[row], 0, network.words + p.length);
}

void check(const Targets& t, const Network& network) {
    check_kind(network.canonical, "targets");
    check_range("targets of a table", t.rows, 0, INT32_MAX);
    for (int64_t i = 0; i < t.rows * network.groups; i++)
        check_range("word of a target", t.words[i], 0, network.words - 1);
}

Trained::Trained(const Network& network)
    : shape(checked(network)), layout(layout_of(network)), parameters(layout.size),
      target(layout.size), gradient(layout.size), first_moment(layout.size),
      second_moment(layout.size) {}

Tensors Trained::tensors() const {
    return {parameters.data(), target.data(), gradient.data(), first_moment.data(),
            second_moment.data()};
}

Engine::Engine(const Network& actor, const Network& critic, const Settings& settings, int threads,
               const Level& used)
    : actor_(actor), critic_(critic), settings_(settings), kernel_(used.kernel),
      team_(check_threads(threads)) {
    check_pair(actor, critic);
    sizes_.threads = threads;
}

void OwnTable::copy(const Programs& p, const Network& network) {
    pa::check(p, network);
    const int64_t size = p.rows * p.length;
    op_.assign(p.op, p.op + size), a_.assign(p.a, p.a + size), b_.assign(p.b, p.b + size);
    relation_.assign(p.relation, p.relation + p.rows);
    for (int set = 0; set < kSets; set++) sets_[set].assign(p.sets[set], p.sets[set] + p.rows);
    rows = p.rows, length = p.length;
}

void OwnTable::copy(const Targets& t, const Network& network) {
    pa::check(t, network);
    words_.assign(t.words, t.words + t.rows * network.groups);
    rows = t.rows;
}

Table OwnTable::table() const {
    return {(int32_t)length, op_.data(), a_.data(), b_.data(), relation_.data(),
            {sets_[kMoved].data(), sets_[kTarget].data(), sets_[kAvoided].data()}, words_.data()};
}

void Engine::set_programs(const Programs& programs) {
    const std::lock_guard<std::mutex> turn(turn_);
    table_.copy(programs, actor_.shape);
}

void Engine::set_targets(const Targets& targets) {
    const std::lock_guard<std::mutex> turn(turn_);
    table_.copy(targets, actor_.shape);
}

Metrics Engine::update(Batch batch) {
    const std::lock_guard<std::mutex> turn(turn_);
    check(batch);
    fit(batch);
    batch.table = table_.table();
    auto gradients = [&](int part) { learner_->gradients(batch, part); };
    auto apply = [&](int part) { learner_->apply(batch, part); };
    team_.run(gradients);
    team_.run(apply);
    return learner_->metrics(batch);
}

void Engine::check(const Batch& batch) const {
    check_range("transitions", batch.transitions, 1, kMaxTransitions);
    check_range("programs", batch.programs, 1, kMaxPrograms);
    check_scene(batch.objects, batch.hand_index);
    const int64_t size = (int64_t)batch.transitions * batch.programs;
    for (const int32_t* row = batch.program; row < batch.program + size; row++)
        if (*row < 0 || *row >= table_.rows)
            throw Error("expected programs below " + std::to_string(table_.rows) + ", got " +
                        std::to_string(*row));
}

// Makes the scratch memory anew unless the present one is large enough.
void Engine::fit(const Batch& batch) {
    const Sizes& now = sizes_;
    const bool same = now.objects == batch.objects && now.programs == batch.programs;
    if (learner_ && same && batch.transitions <= now.transitions && table_.length <= now.length) return;
    const Sizes sizes{batch.transitions, batch.objects, batch.programs, (int32_t)table_.length,
                      now.threads};
    learner_.reset();
    learner_.reset(kernel_->make_learner({actor_.shape, critic_.shape, actor_.tensors(),
                                          critic_.tensors(), settings_, sizes}));
    sizes_ = sizes;
}

Actor::Actor(const Network& network, const Level& used)
    : shape_(checked(network)), kernel_(used.kernel), parameters_(layout_of(network).size),
      sized_(kMaxObjects + 1) {
    if (network.critic) throw Error("expected an actor, got a critic");
}

void Actor::set_program(const Programs& program) {
    const std::lock_guard<std::mutex> turn(turn_);
    check_range("programs to act on", program.rows, 1, 1);
    table_.copy(program, shape_);
}

void Actor::set_target(const Targets& target) {
    const std::lock_guard<std::mutex> turn(turn_);
    check_range("targets to act on", target.rows, 1, 1);
    table_.copy(target, shape_);
}

// Scratch memory for so many objects, made anew unless the present one is large enough.
ActorKernel& Actor::kernel_for(const Observation& seen) {
    check_range("programs to act on", table_.rows, 1, 1);
    check_scene(seen.objects, seen.hand_index);
    Sized& sized = sized_[seen.objects];
    if (!sized.kernel || sized.length < table_.length) {
        sized.kernel.reset();
        sized.kernel.reset(kernel_->make_actor(shape_, parameters_.data(), seen.objects, (int)table_.length));
        sized.length = table_.length;
    }
    return *sized.kernel;
}

void Actor::act(const Observation& seen, float* action) {
    const std::lock_guard<std::mutex> turn(turn_);
    kernel_for(seen).act(seen, table_.table(), action);
}

void Actor::degrees(const Observation& seen, float* degrees) {
    const std::lock_guard<std::mutex> turn(turn_);
    check_kind(!shape_.canonical, "programs");
    kernel_for(seen).degrees(seen, table_.table(), degrees);
}

}  // namespace pa
