// The instruction sets that the library was built for, widest first, and which one is used.
#pragma once
#include <string>
#include <vector>

#include "kernel.h"

namespace pa {

struct Level {
    std::string name;
    const Kernel* kernel;
    bool available;  // whether this machine has all of its instructions
};

const std::vector<Level>& levels();

// The level of a name, or the widest available without one. Error for one that is unknown or that
// this machine lacks; it names those there are.
const Level& find_level(const std::string& name);

// What PA_ROS_FUSED_LEVEL asks for, for as long as the process lives.
const Level& level();

}  // namespace pa
