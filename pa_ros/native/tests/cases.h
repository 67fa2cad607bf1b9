// Networks, programs and batches of random numbers.
#pragma once
#include <random>
#include <vector>

#include "engine.h"

struct Case {
    const char* name;
    pa::Network actor, critic;
};

// Programmable (also with hidden properties, several relations, or roles and upper layers), true
// properties in critic or both, canonical.
std::vector<Case> cases(int hidden, int attention, int actions = 6);

// Which floats of a buffer hold weights; the rest is padding and 0.
std::vector<bool> weights_of(const pa::Network& network);

// Small random weights, targets as parameters.
void fill(pa::Trained& trained, std::mt19937& rng);
void fill(float* parameters, const pa::Network& network, std::mt19937& rng);

struct Codes {  // three programs of the longest there is, or targets
    Codes(const pa::Network& network, int length);
    void tell(pa::Engine& engine) const;

    std::vector<int32_t> op, a, b, target, relation, sets[pa::kSets];
    int rows, length;
    bool canonical;
    pa::Programs programs() const {
        return {rows, length, op.data(), a.data(), b.data(), relation.data(),
                {sets[0].data(), sets[1].data(), sets[2].data()}};
    }
    pa::Targets targets() const { return {rows, target.data()}; }
};

struct Transitions {
    Transitions(int transitions, int objects, int programs, int rows, int actions,
                std::mt19937& rng);
    pa::Batch batch() const;

    int transitions, objects, programs;
    std::vector<float> object, arm, action, next_object, next_arm, reward, discount;
    std::vector<int32_t> program;
};
