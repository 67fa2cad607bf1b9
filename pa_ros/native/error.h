// What the library refuses: FusedError in Python.
#pragma once
#include <cstdint>
#include <stdexcept>
#include <string>

namespace pa {

class Error : public std::runtime_error {
  public:
    explicit Error(const std::string& message) : std::runtime_error("fused engine: " + message) {}
};

// Error unless least <= value <= most.
inline void check_range(const char* name, int64_t value, int64_t least, int64_t most) {
    if (value < least || value > most)
        throw Error(std::string(name) + ": expected " + std::to_string(least) + " … " +
                    std::to_string(most) + ", got " + std::to_string(value));
}

}  // namespace pa
