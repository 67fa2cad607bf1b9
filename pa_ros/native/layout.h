// What describes a network, and where each tensor lies in its flat buffer.
#pragma once
#include <cstdint>

namespace pa {

constexpr int kObjectFeatures = 16;
constexpr int kArmFeatures = 18;
constexpr int kArmColumns = 20;                                    // 18, then a 1 for the bias
constexpr int kColumnRows = kObjectFeatures + kArmFeatures + 1;    // 34 inputs and the bias
constexpr int kBiasRow = kObjectFeatures + kArmFeatures;
constexpr int kProperty = 7, kProperties = 9;                      // one-hots within an object's 16
constexpr int kActions = 6;
constexpr int kActionColumns = 16;                                 // row stride of actions inside
constexpr int kLane = 16;                                          // floats; all rows are padded to it
constexpr int kMaxHidden = 8192;
constexpr int kMaxGroups = 8;
constexpr int kMaxWords = 128;
constexpr int kMaxSlots = 32;
constexpr int kMaxObjects = 64;
constexpr int kMaxPrograms = 64;                                   // per transition
constexpr int kMaxThreads = 64;
constexpr int kMaxLength = 1024;                                   // instructions of a program
constexpr int kMaxTransitions = 1 << 20;                           // of a batch
constexpr int kTargetWords = 2;                                    // that canonical networks read
constexpr float kLargestPart = 43.6f;                              // see simd.h

[[gnu::always_inline]] constexpr int64_t padded(int64_t size) {
    return (size + kLane - 1) / kLane * kLane;
}

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

Layout layout_of(const Network& network);

// Error unless the code can compute a network without leaving its buffers.
void check(const Network& network);

}  // namespace pa
