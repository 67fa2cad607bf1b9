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
    for (int64_t i = 0; network.sets() && i < 2 * p.rows; i++)
        check_range("register of a role", p.roles[i], 0, network.words + p.length);
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

void Engine::set_programs(const Programs& p) {
    const std::lock_guard<std::mutex> turn(turn_);
    pa::check(p, actor_.shape);
    const int64_t size = p.rows * p.length;
    op_.assign(p.op, p.op + size), a_.assign(p.a, p.a + size), b_.assign(p.b, p.b + size);
    relation_.assign(p.relation, p.relation + (actor_.shape.relations ? p.rows : 0));
    roles_.assign(p.roles, p.roles + (actor_.shape.sets() ? 2 * p.rows : 0));
    rows_ = p.rows, length_ = p.length;
}

void Engine::set_targets(const Targets& t) {
    const std::lock_guard<std::mutex> turn(turn_);
    pa::check(t, actor_.shape);
    target_.assign(t.words, t.words + t.rows * actor_.shape.groups);
    rows_ = t.rows;
}

Metrics Engine::update(Batch batch) {
    const std::lock_guard<std::mutex> turn(turn_);
    check(batch);
    fit(batch);
    batch.table = {(int32_t)length_, op_.data(), a_.data(), b_.data(), target_.data(),
                   relation_.data(), roles_.data()};
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
        if (*row < 0 || *row >= rows_)
            throw Error("expected programs below " + std::to_string(rows_) + ", got " +
                        std::to_string(*row));
}

// Makes the scratch memory anew unless the present one is large enough.
void Engine::fit(const Batch& batch) {
    const Sizes& now = sizes_;
    const bool same = now.objects == batch.objects && now.programs == batch.programs;
    if (learner_ && same && batch.transitions <= now.transitions && length_ <= now.length) return;
    const Sizes sizes{batch.transitions, batch.objects, batch.programs, (int32_t)length_,
                      now.threads};
    learner_.reset();
    learner_.reset(kernel_->make_learner({actor_.shape, critic_.shape, actor_.tensors(),
                                          critic_.tensors(), settings_, sizes}));
    sizes_ = sizes;
}

Actor::Actor(const Network& network, const Level& used)
    : shape_(checked(network)), kernel_(used.kernel), parameters_(layout_of(network).size) {
    if (network.critic) throw Error("expected an actor, got a critic");
}

void Actor::act(const Observation& seen, const Programs& program, float* action) {
    check_range("programs to act on", program.rows, 1, 1);
    check(program, shape_);
    act(seen, Table{(int32_t)program.length, program.op, program.a, program.b, nullptr,
                    program.relation, program.roles}, action);
}

void Actor::act(const Observation& seen, const Targets& target, float* action) {
    check_range("targets to act on", target.rows, 1, 1);
    check(target, shape_);
    act(seen, Table{1, nullptr, nullptr, nullptr, target.words, nullptr, nullptr}, action);
}

void Actor::act(const Observation& seen, const Table& table, float* action) {
    const std::lock_guard<std::mutex> turn(turn_);
    check_scene(seen.objects, seen.hand_index);
    if (!actor_ || objects_ != seen.objects || length_ < table.length) {
        actor_.reset();
        actor_.reset(kernel_->make_actor(shape_, parameters_.data(), seen.objects, table.length));
        objects_ = seen.objects, length_ = table.length;
    }
    actor_->act(seen, table, action);
}

}  // namespace pa
