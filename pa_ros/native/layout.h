// The C interface of the fused update, and where each tensor lies in a network's flat buffer.
//
// Plain types only: this header is shared by every instruction-set level and mirrored, field by
// field, by pa_ros/native/library.py.
#pragma once
#include <cstdint>

namespace pa {

constexpr int kInterface = 19;  // raise it when anything that Python mirrors changes
constexpr int kObjectFeatures = 16;
constexpr int kArmFeatures = 18;
constexpr int kArmColumns = 20;                                    // 18, then a 1 for the bias
constexpr int kColumnRows = kObjectFeatures + kArmFeatures + 1;    // 34 inputs and the bias
constexpr int kBiasRow = kObjectFeatures + kArmFeatures;
constexpr int kProperty = 7, kProperties = 9;                      // one-hots within an object's 16
constexpr int kActions = 6;
constexpr int kActionColumns = 16;                                 // row stride of actions inside
constexpr int kLane = 16;                                          // floats; all rows are padded to it
constexpr int kMaxGroups = 8;
constexpr int kMaxWords = 128;
constexpr int kMaxSlots = 32;

inline int64_t padded(int64_t size) { return (size + kLane - 1) / kLane * kLane; }

// One network. `detectors` 0: Φ is true, word v is object feature truth[v] (-1: names nothing).
struct Network {
    int32_t hidden, attention, words, groups;
    int32_t group_size[kMaxGroups];
    int32_t detectors;
    int32_t hide_properties;  // f, r and α̃ have zero weights for the one-hots, and keep them
    int32_t critic;  // 1: reads an action, writes one number; 0: writes kActions
    int32_t truth[kMaxWords];
    float position_scale;
    float self_weight;  // multiplies exp α̃_ii
    int32_t canonical;  // 1: an MLP of the flattened Ω; attention and detectors are 0
    int32_t slots;      // of that: slot i is of the objects with these two one-hot features
    int32_t slot_shape[kMaxSlots], slot_color[kMaxSlots];
};

// Offsets and sizes in floats. Rows are input-major ([in][out]): a torch weight is the transpose.
//   first        [35][columns]   row: 16 object features, 18 arm features, bias; columns: local.0,
//                                message.0 of the receiver (with its bias), message.0 of the sender
//                                (bias always 0), query, context, detectors, each padded
//   attention    [A]
//   second       [2H][H]         local.1, then message.1
//   second_bias  [2][H]          local.1, then message.1
//   action       [7][H]          critic: 6 inputs, then the bias
//   output       [1 or 6][H]     as torch's
//   output_bias  [16]
// Canonical networks have no `attention`, and
//   first        [inputs + V + 1][H]  hand, slots, arm; words of the target; bias
//   second       [H][H]               of the hidden units, without the critic's action
//   second_bias  [H]                  the actor's; the critic's is in `action`
// H and A are padded; the padding is zero and stays zero.
struct Layout {
    int64_t hidden, attention, columns;
    int64_t local, receiver, sender, query, context, detectors;  // first columns within `first`
    int64_t first, attention_weight, second, second_bias, action, output, output_bias, size;
    int64_t inputs;  // canonical: of the flattened Ω without the target
};

// From the layer that the action enters on: the same in all networks.
inline void lay_out_heads(Layout& l, const Network& n, int64_t from) {
    l.action = from;
    l.output = l.action + (n.critic ? (kActions + 1) * l.hidden : 0);
    l.output_bias = l.output + (n.critic ? 1 : kActions) * l.hidden;
    l.size = l.output_bias + kLane;
}

inline Layout mlp_layout_of(const Network& n) {
    Layout l{};
    l.hidden = l.columns = padded(n.hidden);
    l.inputs = (1 + n.slots) * kObjectFeatures + kArmFeatures;
    l.second = (l.inputs + n.words + 1) * l.hidden;
    l.second_bias = l.second + l.hidden * l.hidden;
    lay_out_heads(l, n, l.second_bias + l.hidden);
    return l;
}

inline Layout layout_of(const Network& n) {
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

// Buffers of one trained network, each Layout::size floats, 64-byte aligned, owned by the caller.
struct Tensors {
    float *parameters, *target, *gradient, *first_moment, *second_moment;
};

// The caller's, who may change them between updates.
struct Settings {
    double actor_rate, critic_rate, beta1, beta2, epsilon, clip, action_l2, detector_gain;
    double detector_decay, detector_decay_updates;
};

// B transitions of N objects × K programs, and the table they point into (see docs/DESIGN.md). For
// canonical networks a row of the table is one instruction, whose a and b are the target's words.
struct Batch {
    int32_t transitions, objects, programs, hand_index;
    const float *object, *arm, *action, *next_object, *next_arm;
    const int32_t* program;
    const float *reward, *discount;
    int32_t table_rows, table_length;
    const int32_t *op, *a, *b;
};

// `largest_part`: of the sums x + y under tanh, the largest |x| or |y|. Beyond 43.6 a part is
// clamped, so a sum of two such parts of opposite sign is wrong (see simd.h).
struct Metrics {
    double critic_loss, mean_q, actor_gradient_norm, largest_part;
};

}  // namespace pa
