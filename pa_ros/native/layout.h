// What describes a network, and where each tensor lies in its flat buffer.
#pragma once
#include <cstdint>

namespace pa {

constexpr int kPose = 7;                                           // features before the properties
constexpr int kMaxFeatures = 256;                                  // of an object, its pose included
constexpr int kMaxActions = 16;
constexpr int kMaxArmFeatures = 3 * kMaxActions + kPose;
constexpr int kMaxNumbers = 4096;                                  // of all words' values
constexpr int kActionColumns = 16;                                 // row stride of actions inside
constexpr int kLane = 16;                                          // floats; all rows are padded to it
constexpr int kMaxHidden = 8192;
constexpr int kMaxGroups = 8;
constexpr int kMaxWords = 128;
constexpr int kMaxSlots = 32;
constexpr int kMaxObjects = 64;
constexpr int kMaxPrograms = 64;                                   // per transition
constexpr int kMaxThreads = 64;
constexpr int kMaxRelations = 16;
constexpr int kMaxUpper = 4;                                       // layers between h and output
constexpr int kMaxLength = 1024;                                   // instructions of a program
constexpr int kMaxTransitions = 1 << 20;                           // of a batch
constexpr float kLargestPart = 43.6f;                              // see simd.h

[[gnu::always_inline]] constexpr int64_t padded(int64_t size) {
    return (size + kLane - 1) / kLane * kLane;
}

// A word's value: true of an object whose features [at, at + width), as networks see them, are
// within the square root of `square` of numbers [numbers, numbers + width). Width 0: of none.
struct Word {
    int32_t at, width, numbers;
    float square;
};

// One network. `detectors` 0: Φ is true. An object's features are multiplied by `scale`.
struct Network {
    int32_t object_features, arm_features, actions;
    int32_t hidden, attention, words, groups;
    int32_t group_size[kMaxGroups];
    int32_t detectors;
    int32_t hide_properties;  // f, r and α̃ have zero weights for the properties, and keep them
    int32_t min_max;  // of an actor that doesn't learn: AND and OR of degrees are min and max
    int32_t critic;  // 1: reads an action, writes one number; 0: writes an action
    Word word[kMaxWords];
    float number[kMaxNumbers];
    float scale[kMaxFeatures];
    float self_weight;  // multiplies exp α̃_ii
    int32_t roles;  // 1: programs say what is moved and where to (docs/DESIGN.md, "Roles")
    int32_t avoids;  // 1: programs say what is avoided (docs/DESIGN.md, "Avoiding")
    int32_t upper;  // layers between h and the output
    int32_t relations;  // that programs may ask for; 0 where there is one alone, which adds nothing
    int32_t canonical;  // 1: an MLP of the flattened Ω; attention and detectors are 0
    int32_t slots;      // of that: slot i is of the objects of which these words are true
    int32_t slot_word[kMaxSlots][kMaxGroups];
};

// Offsets and sizes in floats. Rows are input-major ([in][out]): a torch weight is the transpose.
//   first        [rows][columns] row: object features, arm features, bias; columns: local.0,
//                                avoid.0 where there is one, message.0 of the receiver (with its bias), message.0 of the sender
//                                (bias always 0), query, context, detectors, each padded
//   attention    [A]
//   relation     [R][H]          what each adds to message.0, where there are several
//   second       [2H or 3H][H]   local.1, message.1, then avoid.1 where there is one
//   second_bias  [2][H]          local.1, then message.1
//   upper        [U][H + 1][H]   each layer between h and the output, then its bias
//   action       [J + 1][H]      critic: J inputs, then the bias
//   output       [1 or J][H]     as torch's
//   output_bias  [16]
// Canonical networks have no `attention`, and
//   first        [inputs + V + 1][H]  hand, slots, arm; words of the target; bias
//   second       [H][H]               of the hidden units, without the critic's action
//   second_bias  [H]                  the actor's; the critic's is in `action`
// H and A are padded; the padding is zero and stays zero.
struct Layout {
    int64_t hidden, attention, columns, rows;
    int64_t parts;  // layers in `second`
    int64_t local, avoid, receiver, sender, query, context, detectors;  // first columns within `first`
    int64_t first, attention_weight, relation, second, second_bias, upper, action, output, output_bias, size;
    int64_t inputs;  // canonical: of the flattened Ω without the target
};

Layout layout_of(const Network& network);

// Error unless the code can compute a network without leaving its buffers.
void check(const Network& network);

}  // namespace pa
