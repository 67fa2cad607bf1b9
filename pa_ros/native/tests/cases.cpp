#include "cases.h"

#include <algorithm>

using namespace pa;

namespace {

constexpr int kWords = 9, kFeatures = kPose + kWords + 1;

// Two groups of one-hots, of 4 and 5 words, the fourth of which names nothing; then a real feature.
Network world(int hidden, int actions, bool critic) {
    Network n{};
    n.object_features = kFeatures, n.arm_features = 3 * actions, n.actions = actions;
    n.hidden = hidden, n.words = kWords, n.groups = 2, n.group_size[0] = 4, n.group_size[1] = 5;
    for (int v = 0; v < kWords; v++) {
        const int at = v < 4 ? kPose : kPose + 4, width = v < 4 ? 4 : 5, from = v * 5;
        n.word[v] = {at, v == 3 ? 0 : width, from, 0.25f};
        n.number[from + kPose + v - at] = 1.0f;
    }
    for (int f = 0; f < kFeatures; f++) n.scale[f] = f < 3 ? 3.0f : 1.0f;
    n.critic = critic;
    return n;
}

Network trunk(int hidden, int attention, int actions, bool detectors, bool hides, bool critic) {
    Network n = world(hidden, actions, critic);
    n.attention = attention, n.detectors = detectors, n.hide_properties = hides;
    n.self_weight = 0.5f;
    return n;
}

Network canonical(int hidden, int actions, bool critic) {
    Network n = world(hidden, actions, critic);
    n.canonical = 1, n.slots = 5;
    for (int i = 0; i < n.slots; i++) n.slot_word[i][0] = i % 4, n.slot_word[i][1] = 4 + i;
    return n;
}

std::vector<float> normal(size_t size, float scale, std::mt19937& rng) {
    std::normal_distribution<float> draw(0.0f, scale);
    std::vector<float> made(size);
    for (float& x : made) x = draw(rng);
    return made;
}

std::vector<float> scenes(int count, int objects, std::mt19937& rng) {
    std::vector<float> made = normal((size_t)count * objects * kFeatures, 0.3f, rng);
    for (size_t i = 0; i < made.size(); i += kFeatures) {
        std::fill_n(&made[i + kPose], kWords, 0.0f);
        made[i + kPose + rng() % 4] = made[i + kPose + 4 + rng() % 5] = 1.0f;
    }
    return made;
}

}  // namespace

std::vector<Case> cases(int hidden, int attention, int actions) {
    const auto of = [&](bool actor, bool critic, bool hides) {
        return std::pair{trunk(hidden, attention, actions, actor, hides, false),
                         trunk(hidden, attention, actions, critic, hides, true)};
    };
    const auto both = of(true, true, false), hides = of(true, true, true);
    auto several = hides;
    several.first.relations = several.second.relations = 3;
    auto moving = both;
    moving.first.roles = moving.second.roles = 1, moving.first.upper = moving.second.upper = 2;
    auto avoiding = hides;
    avoiding.first.avoids = avoiding.second.avoids = 1;
    const auto distilled = of(true, false, false), truth = of(false, false, false);
    return {{"programmable", both.first, both.second},
            {"hidden properties", hides.first, hides.second},
            {"distilled critic", distilled.first, distilled.second},
            {"true properties", truth.first, truth.second},
            {"canonical", canonical(hidden, actions, false), canonical(hidden, actions, true)},
            {"several relations", several.first, several.second},
            {"roles and upper layers", moving.first, moving.second},
            {"what is avoided", avoiding.first, avoiding.second}};
}

std::vector<bool> weights_of(const Network& n) {
    const Layout l = layout_of(n);
    std::vector<bool> used((size_t)l.size);
    const auto mark = [&](int64_t at, int64_t rows, int64_t columns, int64_t stride) {
        for (int64_t r = 0; r < rows; r++) std::fill_n(used.begin() + at + r * stride, columns, true);
    };
    if (n.canonical) {
        mark(l.first, l.inputs + n.words + 1, n.hidden, l.hidden);
        mark(l.second, n.hidden, n.hidden, l.hidden);
        if (!n.critic) mark(l.second_bias, 1, n.hidden, l.hidden);
    } else {
        for (int64_t at : {l.local, l.receiver}) mark(at, l.rows, n.hidden, l.columns);
        mark(l.sender, l.rows - 1, n.hidden, l.columns);  // its bias is the receiver's
        for (int64_t at : {l.query, l.context}) mark(at, l.rows, n.attention, l.columns);
        if (n.detectors) mark(l.detectors, l.rows, n.words, l.columns);
        mark(l.attention_weight, 1, n.attention, l.attention);
        mark(l.relation, n.relations, n.hidden, l.hidden);
        if (n.avoids) mark(l.avoid, l.rows, n.hidden, l.columns);
        for (int64_t part = 0; part < l.parts; part++)
            mark(l.second + part * l.hidden * l.hidden, n.hidden, n.hidden, l.hidden);
        mark(l.second_bias, 2, n.hidden, l.hidden);
        for (int64_t at = l.upper; at < l.action; at += (l.hidden + 1) * l.hidden)
            mark(at, n.hidden, n.hidden, l.hidden), mark(at + l.hidden * l.hidden, 1, n.hidden, l.hidden);
    }
    if (n.critic) mark(l.action, n.actions + 1, n.hidden, l.hidden);
    mark(l.output, n.critic ? 1 : n.actions, n.hidden, l.hidden);
    mark(l.output_bias, 1, n.critic ? 1 : n.actions, kLane);
    return used;
}

void fill(float* parameters, const Network& network, std::mt19937& rng) {
    const std::vector<bool> used = weights_of(network);
    const std::vector<float> drawn = normal(used.size(), 0.2f, rng);
    for (size_t i = 0; i < used.size(); i++) parameters[i] = used[i] ? drawn[i] : 0.0f;
}

void fill(Trained& trained, std::mt19937& rng) {
    fill(trained.parameters.data(), trained.shape, rng);
    std::copy_n(trained.parameters.data(), trained.layout.size, trained.target.data());
}

Codes::Codes(const Network& network, int length) : rows(3), length(length) {
    canonical = network.canonical;
    target = {0, 4, 1, 8, 3, 5}, relation = {2, 0, 2};
    sets[kMoved] = {kWords, kWords + length, 2}, sets[kTarget] = {0, 4, kWords};
    sets[kAvoided] = {0, 4, kWords};
    for (int i = 0; i < rows * length; i++) {
        const int k = i % length, last = kWords + k;  // registers: words, the hand, results
        op.push_back((i + i / length) % 4);
        a.push_back(last), b.push_back(k ? last - 1 : i / length);
    }
}

void Codes::tell(Engine& engine) const {
    if (canonical) return engine.set_targets(targets());
    engine.set_programs(programs());
}

Transitions::Transitions(int transitions, int objects, int programs, int rows, int actions,
                         std::mt19937& rng)
    : transitions(transitions), objects(objects), programs(programs) {
    object = scenes(transitions, objects, rng), next_object = scenes(transitions, objects, rng);
    arm = normal((size_t)transitions * 3 * actions, 1.0f, rng);
    next_arm = normal((size_t)transitions * 3 * actions, 1.0f, rng);
    action = normal((size_t)transitions * actions, 0.5f, rng);
    reward = normal((size_t)transitions * programs, 1.0f, rng);
    discount.assign((size_t)transitions, 0.9f);
    for (int i = 0; i < transitions * programs; i++) program.push_back((int32_t)(rng() % rows));
}

Batch Transitions::batch() const {
    Batch b{};
    b.transitions = transitions, b.objects = objects, b.programs = programs;
    b.object = object.data(), b.arm = arm.data(), b.action = action.data();
    b.next_object = next_object.data(), b.next_arm = next_arm.data();
    b.program = program.data(), b.reward = reward.data(), b.discount = discount.data();
    b.correction1 = 0.1, b.correction2 = 0.001;
    return b;
}
