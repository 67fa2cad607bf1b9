// Updates with one and two threads, actions and refusals, on every level that this machine has.
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <string>

#include "cases.h"
#include "error.h"

using namespace pa;

namespace {

struct Size {
    int hidden, attention, transitions, objects, programs, length, actions;
};

const Size kSizes[] = {{7, 3, 1, 1, 1, 1, 6},  {20, 17, 5, 3, 2, 4, 7}, {33, 16, 13, 17, 3, 2, 1},
                       {16, 5, 70, 5, 1, 3, 6}, {24, 8, 9, 2, 11, 6, 16}};

void require(bool holds, const std::string& what) {
    if (holds) return;
    std::fprintf(stderr, "failed: %s\n", what.c_str());
    std::exit(1);
}

// Both networks' parameters after three updates, the last of which has other sizes.
std::vector<float> updated(const Case& made, const Size& size, int threads, const Level& level) {
    const std::string name = std::string(made.name) + ", " + level.name;
    std::mt19937 rng(1);
    const Settings settings{1e-3, 2e-3, 0.9, 0.999, 1e-8, 1.0, 2.0, 0.1, 1.0, true};
    Engine engine(made.actor, made.critic, settings, threads, level);
    fill(engine.actor(), rng), fill(engine.critic(), rng);
    Codes(made.actor, size.length).tell(engine);
    for (int step = 0; step < 3; step++) {
        const int transitions = step == 2 ? size.transitions / 2 + 1 : size.transitions;
        const Transitions given(transitions, size.objects + (step == 2), size.programs, 3,
                                size.actions, rng);
        const Metrics metrics = engine.update(given.batch());
        require(std::isfinite(metrics.critic_loss) && metrics.actor_gradient_norm > 0, name);
    }
    std::vector<float> all;
    for (Trained* trained : {&engine.actor(), &engine.critic()}) {
        const std::vector<bool> used = weights_of(trained->shape);
        for (size_t i = 0; i < used.size(); i++) {
            const float x = trained->parameters.data()[i];
            require(std::isfinite(x) && (used[i] || x == 0.0f), name + ": padding stays 0");
            all.push_back(x);
        }
    }
    return all;
}

double distance(const std::vector<float>& x, const std::vector<float>& y) {
    double most = 0;
    for (size_t i = 0; i < x.size(); i++) most = std::fmax(most, std::fabs(x[i] - y[i]));
    return most;
}

// Threads and instruction sets differ in rounding alone; Adam may double it where gradients vanish.
void test_updates() {
    for (const Size& size : kSizes)
        for (const Case& made : cases(size.hidden, size.attention, size.actions)) {
            const std::vector<float> expected = updated(made, size, 1, find_level("generic"));
            for (const Level& level : levels())
                for (int threads = 1; level.available && threads <= 3; threads++) {
                    const std::vector<float> found = updated(made, size, threads, level);
                    require(distance(found, expected) < 2e-2, std::string(made.name) + " agrees");
                    require(found == updated(made, size, threads, level), "the same bits again");
                }
        }
}

void test_actions_of(const Size& size, const Case& made, const Level& level) {
    std::mt19937 rng(2);
    Actor actor(made.actor, level);
    fill(actor.parameters().data(), made.actor, rng);
    for (int objects : {size.objects, size.objects + 1, 64}) {
        const Codes table(made.actor, size.length + objects % 3);
        const Transitions seen(1, objects, 1, 1, size.actions, rng);
        float action[kMaxActions] = {};
        Programs program = table.programs();
        Targets target = table.targets();
        program.rows = target.rows = 1;
        const Observation given{objects, objects - 1, seen.object.data(), seen.arm.data()};
        if (made.actor.canonical) actor.set_target(target);
        else actor.set_program(program);
        actor.act(given, action);
        for (float x : action) require(x >= -1 && x <= 1, "actions are bounded");
        if (made.actor.canonical) continue;
        std::vector<float> degrees((1 + kSets) * objects);
        actor.degrees(given, degrees.data());
        for (float x : degrees) require(x >= 0 && x <= 1.0001f, "degrees are degrees");
    }
}

void test_actions() {
    for (const Size& size : kSizes)
        for (Case made : cases(size.hidden, size.attention, size.actions))
            for (const int32_t min_max : {0, 1}) {
                made.actor.min_max = min_max;
                for (const Level& level : levels())
                    if (level.available) test_actions_of(size, made, level);
            }
}

void refused(const std::string& what, const std::function<void()>& attempt) {
    try {
        attempt();
    } catch (const Error&) {
        return;
    }
    require(false, what + " is refused");
}

void test_refusals() {
    const Case made = cases(8, 4)[0], flat = cases(8, 4)[4], mixed = cases(8, 4)[5];
    const Settings settings{1e-3, 2e-3, 0.9, 0.999, 1e-8, 1.0, 1.0, 0.1, 1.0, true};
    std::mt19937 rng(3);
    const Transitions given(4, 3, 2, 3, 6, rng);
    Engine engine(made.actor, made.critic, settings, 1), other(flat.actor, flat.critic, settings, 1);
    refused("a row before there are programs", [&] { engine.update(given.batch()); });
    Codes table(made.actor, 4), targets(flat.actor, 1);
    for (auto* part : {&table.op, &table.a, &table.b})
        for (int wrong : {-1, 9 + 4, 1 << 30}) {
            Codes bad = table;
            auto* changed = part == &table.op ? &bad.op : part == &table.a ? &bad.a : &bad.b;
            (*changed)[3] = wrong;
            refused("a register that is not there yet", [&] { bad.tell(engine); });
        }
    table.tell(engine);
    engine.update(given.batch());
    for (int wrong : {-1, 9}) {
        targets.target[1] = wrong;
        refused("a target's word that is not there", [&] { targets.tell(other); });
    }
    Engine several(mixed.actor, mixed.critic, settings, 1);
    for (int wrong : {-1, 3}) {
        Codes bad = table;
        bad.relation[1] = wrong;
        refused("a relation that is not there", [&] { bad.tell(several); });
        bad.tell(engine);  // which asks for none
    }
    table.tell(engine);
    refused("targets for a trunk", [&] { engine.set_targets(targets.targets()); });
    const std::function<void(Batch&)> changes[] = {
        [](Batch& b) { b.hand_index = 3; }, [](Batch& b) { b.hand_index = -1; },
        [](Batch& b) { b.objects = 65; },   [](Batch& b) { b.programs = 65; },
        [](Batch& b) { b.transitions = 0; }};
    for (const auto& change : changes) {
        Batch batch = given.batch();
        change(batch);
        refused("a batch out of range", [&] { engine.update(batch); });
    }
    Transitions wrong = given;
    wrong.program[7] = 3;
    refused("a program that is not there", [&] { engine.update(wrong.batch()); });
    Network network = made.actor;
    network.group_size[1] = 6;
    refused("groups of more than the words", [&] { Actor actor(network); });
    network = mixed.actor;
    network.relations = 17;
    refused("more relations than there can be", [&] { Actor actor(network); });
    network = mixed.critic;
    network.relations = 2;
    refused("other relations", [&] { Engine e(mixed.actor, network, settings, 1); });
    refused("networks that differ", [&] { Engine e(made.actor, flat.critic, settings, 1); });
    network = made.actor;
    network.min_max = 1;
    refused("what can't be differentiated", [&] { Engine e(network, made.critic, settings, 1); });
    refused("no threads", [&] { Engine e(made.actor, made.critic, settings, 0); });
    refused("a level that is not known", [] { find_level("x86-64-v5"); });
}

}  // namespace

int main() {
    test_updates();
    test_actions();
    test_refusals();
    std::puts("the fused engine: updates, actions and refusals are as they should be");
}
