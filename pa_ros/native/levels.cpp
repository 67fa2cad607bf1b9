#include "levels.h"

#include <cstdlib>

#include "error.h"

namespace pa {

#if defined(__x86_64__)
namespace v4 {
extern const Kernel kernel;
}
namespace v3 {
extern const Kernel kernel;
}
#endif
namespace generic {
extern const Kernel kernel;
}

// Beside the tables they head: see level.h.
LearnerKernel::~LearnerKernel() = default;
ActorKernel::~ActorKernel() = default;

namespace {

#if defined(__x86_64__)
// What the x86-64 psABI's levels 3 and 4 add to the one before; the operating system saves the wide
// registers, or the processor's bits for them would not count.
bool has_v3() {
    return __builtin_cpu_supports("x86-64-v2") && __builtin_cpu_supports("avx") &&
           __builtin_cpu_supports("avx2") && __builtin_cpu_supports("bmi") &&
           __builtin_cpu_supports("bmi2") && __builtin_cpu_supports("f16c") &&
           __builtin_cpu_supports("fma") && __builtin_cpu_supports("lzcnt") &&
           __builtin_cpu_supports("movbe") && __builtin_cpu_supports("osxsave");
}

bool has_v4() {
    return has_v3() && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
           __builtin_cpu_supports("avx512cd") && __builtin_cpu_supports("avx512dq") &&
           __builtin_cpu_supports("avx512vl");
}
#endif

std::vector<Level> make_levels() {
    std::vector<Level> made;
#if defined(__x86_64__)
    __builtin_cpu_init();
    made.push_back({"x86-64-v4", &v4::kernel, has_v4()});
    made.push_back({"x86-64-v3", &v3::kernel, has_v3()});
#endif
    made.push_back({"generic", &generic::kernel, true});
    return made;
}

}  // namespace

const std::vector<Level>& levels() {
    static const std::vector<Level> made = make_levels();
    return made;
}

const Level& find_level(const std::string& name) {
    std::string known, available;
    for (const Level& level : levels()) {
        if (level.available && (name.empty() || name == level.name)) return level;
        known += (known.empty() ? "" : ", ") + level.name;
        if (level.available) available += (available.empty() ? "" : ", ") + level.name;
    }
    throw Error("PA_ROS_FUSED_LEVEL: expected one of " + known + " (this machine has " + available +
                "), got '" + name + "'");
}

const Level& level() {
    static const Level& chosen = [&]() -> const Level& {
        const char* wanted = std::getenv("PA_ROS_FUSED_LEVEL");
        return find_level(wanted ? wanted : "");
    }();
    return chosen;
}

}  // namespace pa
