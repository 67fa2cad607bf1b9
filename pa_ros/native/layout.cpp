#include "layout.h"

#include "error.h"

namespace pa {

namespace {

// From the layer that the action enters on: the same in all networks.
void lay_out_heads(Layout& l, const Network& n, int64_t from) {
    l.action = from;
    l.output = l.action + (n.critic ? (kActions + 1) * l.hidden : 0);
    l.output_bias = l.output + (n.critic ? 1 : kActions) * l.hidden;
    l.size = l.output_bias + kLane;
}

Layout mlp_layout_of(const Network& n) {
    Layout l{};
    l.hidden = l.columns = padded(n.hidden);
    l.inputs = (1 + n.slots) * kObjectFeatures + kArmFeatures;
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
    l.local = 0, l.receiver = h, l.sender = 2 * h, l.query = 3 * h, l.context = 3 * h + a;
    l.detectors = 3 * h + 2 * a;
    l.columns = l.detectors + (n.detectors ? padded(n.words) : 0);
    l.first = 0;
    l.attention_weight = l.first + kColumnRows * l.columns;
    l.second = l.attention_weight + a;
    l.second_bias = l.second + 2 * h * h;
    lay_out_heads(l, n, l.second_bias + 2 * h);
    return l;
}

void check(const Network& n) {
    check_range("hidden", n.hidden, 1, kMaxHidden);
    check_range("words", n.words, n.canonical ? kTargetWords : 1, kMaxWords);
    if (n.canonical) {
        check_range("slots", n.slots, 1, kMaxSlots);
        for (int i = 0; i < n.slots; i++)
            for (int feature : {n.slot_shape[i], n.slot_color[i]})
                check_range("feature of a slot", feature, 0, kObjectFeatures - 1);
        return;
    }
    check_range("attention", n.attention, 1, kMaxHidden);
    check_range("groups", n.groups, 1, kMaxGroups);
    int words = 0;
    for (int g = 0; g < n.groups; words += n.group_size[g++])
        check_range("size of a group", n.group_size[g], 1, n.words - words);
    check_range("words of all groups", words, n.words, n.words);
    for (int v = 0; v < n.words; v++)
        check_range("feature of a word", n.truth[v], -1, kObjectFeatures - 1);
}

}  // namespace pa
