#include "layout.h"

#include "error.h"

namespace pa {

namespace {

// From the layer that the action enters on: the same in all networks.
void lay_out_heads(Layout& l, const Network& n, int64_t from) {
    l.action = from;
    l.output = l.action + (n.critic ? (n.actions + 1) * l.hidden : 0);
    l.output_bias = l.output + (n.critic ? 1 : n.actions) * l.hidden;
    l.size = l.output_bias + kLane;
}

Layout mlp_layout_of(const Network& n) {
    Layout l{};
    l.hidden = l.columns = padded(n.hidden), l.parts = 1;
    l.inputs = (1 + n.slots) * n.object_features + n.arm_features;
    l.second = (l.inputs + n.words + 1) * l.hidden;
    l.second_bias = l.second + l.hidden * l.hidden;
    lay_out_heads(l, n, l.second_bias + l.hidden);
    return l;
}

}  // namespace

Layout layout_of(const Network& n) {
    Layout l{};
    if (n.canonical) return mlp_layout_of(n);
    const int64_t h = l.hidden = padded(n.hidden), a = l.attention = padded(n.attention);
    l.parts = n.avoids ? 3 : 2;
    l.local = 0, l.avoid = h, l.receiver = n.avoids ? 2 * h : h, l.sender = l.receiver + h;
    l.query = l.sender + h, l.context = l.query + a, l.detectors = l.context + a;
    l.columns = l.detectors + (n.detectors ? padded(n.words) : 0);
    l.first = 0, l.rows = n.object_features + n.arm_features + 1;
    l.attention_weight = l.first + l.rows * l.columns;
    l.relation = l.attention_weight + a;
    l.second = l.relation + n.relations * h;
    l.second_bias = l.second + l.parts * h * h;
    l.upper = l.second_bias + 2 * h;
    lay_out_heads(l, n, l.upper + n.upper * (h + 1) * h);
    return l;
}

void check(const Network& n) {
    check_range("hidden", n.hidden, 1, kMaxHidden);
    check_range("features of an object", n.object_features, kPose, kMaxFeatures);
    check_range("features of the arm", n.arm_features, 1, kMaxArmFeatures);
    check_range("actions", n.actions, 1, kMaxActions);
    check_range("groups", n.groups, 1, kMaxGroups);
    check_range("words", n.words, 1, kMaxWords);
    for (int v = 0; v < n.words; v++) {
        const Word& word = n.word[v];
        check_range("features of a word", word.width, 0, n.object_features);
        check_range("feature of a word", word.at, 0, n.object_features - word.width);
        check_range("numbers of all words", word.numbers, 0, kMaxNumbers - word.width);
    }
    check_range("relations", n.relations, 0, n.canonical ? 0 : kMaxRelations);
    check_range("roles", n.roles, 0, n.canonical ? 0 : 1);
    check_range("avoids", n.avoids, 0, n.canonical || n.roles || n.relations ? 0 : 1);
    check_range("upper layers", n.upper, 0, n.canonical ? 0 : kMaxUpper);
    if (n.canonical) {
        check_range("slots", n.slots, 1, kMaxSlots);
        for (int i = 0; i < n.slots * n.groups; i++)
            check_range("word of a slot", n.slot_word[i / n.groups][i % n.groups], 0, n.words - 1);
        return;
    }
    check_range("attention", n.attention, 1, kMaxHidden);
    int words = 0;
    for (int g = 0; g < n.groups; words += n.group_size[g++])
        check_range("size of a group", n.group_size[g], 1, n.words - words);
    check_range("words of all groups", words, n.words, n.words);
}

}  // namespace pa
