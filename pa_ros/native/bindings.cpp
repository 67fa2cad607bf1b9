// pa_ros.native._fused: what Python sees of the library. Arrays are checked here, what is in them by
// the engine. FusedError is raised for all that is refused.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <algorithm>

#include "engine.h"
#include "error.h"

namespace nb = nanobind;
using namespace nb::literals;

namespace pa {
namespace {

using Array = nb::ndarray<nb::ro, nb::device::cpu>;       // of any kind: see read()
using Writable = nb::ndarray<nb::device::cpu>;
using View = nb::ndarray<nb::numpy, float, nb::ndim<1>>;  // of memory that its owner keeps alive
using Shape = std::vector<int64_t>;

template <class A>
Shape shape_of(const A& array) {
    Shape shape;
    for (size_t i = 0; i < array.ndim(); i++) shape.push_back((int64_t)array.shape(i));
    return shape;
}

std::string text_of(const Shape& shape) {
    std::string text;
    for (int64_t size : shape) text += (text.empty() ? "" : ", ") + std::to_string(size);
    return "(" + text + (shape.size() == 1 ? ",)" : ")");
}

std::string text_of(nb::dlpack::dtype type) {
    using Code = nb::dlpack::dtype_code;
    const Code code = (Code)type.code;
    const char* kind = code == Code::Int     ? "int"
                       : code == Code::UInt  ? "uint"
                       : code == Code::Float ? "float"
                       : code == Code::Bool  ? "bool"
                                             : "dtype";
    return kind + (code == Code::Bool ? "" : std::to_string(type.bits));
}

template <class A>
bool contiguous(const A& array) {
    int64_t stride = 1;
    for (size_t i = array.ndim(); i-- > 0; stride *= (int64_t)array.shape(i))
        if (array.shape(i) > 1 && array.stride(i) != stride) return false;
    return true;
}

// The elements of an array of that type and shape, row-major; FusedError for any other.
template <class T, class A>
auto read(const char* name, const A& array, const Shape& shape) {
    const Shape got = shape_of(array);
    const bool whole = contiguous(array) || array.size() == 0;
    if (array.dtype() != nb::dtype<T>() || got != shape || !whole)
        throw Error(std::string(name) + ": expected contiguous " + text_of(nb::dtype<T>()) + " " +
                    text_of(shape) + ", got " + (whole ? "" : "strided ") + text_of(array.dtype()) +
                    " " + text_of(got));
    return static_cast<std::conditional_t<std::is_same_v<A, Writable>, T*, const T*>>(array.data());
}

void check_aligned(const char* name, const void* data) {
    if (reinterpret_cast<uintptr_t>(data) % (kLane * sizeof(float)))
        throw Error(std::string(name) + ": expected to begin a line of 64 bytes");
}

using Value = std::tuple<int, std::vector<float>, float>;  // first feature, numbers, tolerance

// What networks of both kinds are told of the world.
Network make_network(int arm_features, int actions, const std::vector<float>& scale,
                     const std::vector<int>& group_sizes, const std::vector<Value>& words) {
    check_range("features of an object", (int64_t)scale.size(), kPose, kMaxFeatures);
    check_range("groups", (int64_t)group_sizes.size(), 1, kMaxGroups);
    check_range("words", (int64_t)words.size(), 1, kMaxWords);
    Network n{};
    n.object_features = (int32_t)scale.size(), n.arm_features = arm_features, n.actions = actions;
    n.words = (int32_t)words.size(), n.groups = (int32_t)group_sizes.size();
    std::copy(scale.begin(), scale.end(), n.scale);
    std::copy(group_sizes.begin(), group_sizes.end(), n.group_size);
    size_t used = 0;
    for (size_t v = 0; v < words.size(); v++) {
        const auto& [at, numbers, tolerance] = words[v];
        check_range("numbers of all words", (int64_t)(used + numbers.size()), 0, kMaxNumbers);
        n.word[v] = {at, (int32_t)numbers.size(), (int32_t)used, tolerance * tolerance};
        std::copy(numbers.begin(), numbers.end(), n.number + used);
        used += numbers.size();
    }
    return n;
}

Network make_trunk(int hidden, int attention, int arm_features, int actions,
                   const std::vector<float>& scale, const std::vector<int>& group_sizes,
                   const std::vector<Value>& words, bool detectors, bool hide_properties,
                   bool critic, float self_weight, int relations, bool min_max, bool roles,
                   bool avoids, int upper_layers) {
    Network n = make_network(arm_features, actions, scale, group_sizes, words);
    n.hidden = hidden, n.attention = attention, n.self_weight = self_weight;
    n.relations = relations, n.min_max = min_max, n.roles = roles, n.upper = upper_layers;
    n.avoids = avoids;
    n.detectors = detectors, n.hide_properties = hide_properties, n.critic = critic;
    check(n);
    return n;
}

Network make_canonical(int hidden, int arm_features, int actions, const std::vector<float>& scale,
                       const std::vector<int>& group_sizes, const std::vector<Value>& words,
                       const std::vector<std::vector<int>>& slots, bool critic) {
    check_range("slots", (int64_t)slots.size(), 1, kMaxSlots);
    Network n = make_network(arm_features, actions, scale, group_sizes, words);
    n.hidden = hidden, n.canonical = 1, n.critic = critic, n.slots = (int32_t)slots.size();
    for (size_t i = 0; i < slots.size(); i++) {
        check_range("words of a slot", (int64_t)slots[i].size(), n.groups, n.groups);
        std::copy(slots[i].begin(), slots[i].end(), n.slot_word[i]);
    }
    check(n);
    return n;
}

// B × K of a batch, whose other arrays must have the sizes of these two.
Batch make_batch(const Network& network, const Array& objects, const Array& arm, const Array& action,
                 const Array& next_objects, const Array& next_arm, const Array& program,
                 const Array& reward, const Array& discount, int hand_index,
                 double correction1, double correction2, double rate_share) {
    if (objects.ndim() != 3 || program.ndim() != 2)
        throw Error("expected objects [B, N, F] and program [B, K], got " +
                    text_of(shape_of(objects)) + " and " + text_of(shape_of(program)));
    const int64_t b = (int64_t)objects.shape(0), n = (int64_t)objects.shape(1);
    const int64_t k = (int64_t)program.shape(1);
    check_range("transitions", b, 1, kMaxTransitions);
    check_range("objects", n, 1, kMaxObjects);
    check_range("programs", k, 1, kMaxPrograms);
    Batch made{};
    made.transitions = (int32_t)b, made.objects = (int32_t)n, made.programs = (int32_t)k;
    made.hand_index = hand_index;
    made.correction1 = correction1, made.correction2 = correction2;
    made.rate_share = rate_share;
    made.object = read<float>("objects", objects, {b, n, network.object_features});
    made.arm = read<float>("arm", arm, {b, network.arm_features});
    made.action = read<float>("action", action, {b, network.actions});
    made.next_object = read<float>("next_objects", next_objects, {b, n, network.object_features});
    made.next_arm = read<float>("next_arm", next_arm, {b, network.arm_features});
    made.program = read<int32_t>("program", program, {b, k});
    made.reward = read<float>("reward", reward, {b, k});
    made.discount = read<float>("discount", discount, {b});
    return made;
}

Programs make_programs(const Array& op, const Array& a, const Array& b, const Array& relation,
                       const Array& moved, const Array& target, const Array& avoided) {
    const Shape shape = shape_of(op);
    if (shape.size() != 2) throw Error("op: expected [P, L], got " + text_of(shape));
    const Shape each{shape[0]};
    return {shape[0], shape[1], read<int32_t>("op", op, shape), read<int32_t>("a", a, shape),
            read<int32_t>("b", b, shape), read<int32_t>("relation", relation, each),
            {read<int32_t>("moved", moved, each), read<int32_t>("target", target, each),
             read<int32_t>("avoided", avoided, each)}};
}

Targets make_targets(const Network& network, const Array& words) {
    const int64_t rows = words.ndim() ? (int64_t)words.shape(0) : 0;
    return {rows, read<int32_t>("targets", words, {rows, network.groups})};
}

Observation make_observation(const Network& network, const Array& objects, const Array& arm,
                             int hand_index) {
    const int64_t n = objects.ndim() ? (int64_t)objects.shape(0) : 0;
    check_range("objects", n, 1, kMaxObjects);
    return {(int32_t)n, hand_index, read<float>("objects", objects, {n, network.object_features}),
            read<float>("arm", arm, {network.arm_features})};
}

// Arrays stay alive, being arguments, while other threads of Python run.
void act(Actor& actor, const Array& objects, const Array& arm, int hand_index, const Writable& out) {
    const Observation seen = make_observation(actor.shape(), objects, arm, hand_index);
    float* action = read<float>("action", out, {actor.shape().actions});
    const nb::gil_scoped_release released;
    actor.act(seen, action);
}

void find_degrees(Actor& actor, const Array& objects, const Array& arm, int hand_index, const Writable& out) {
    const Observation seen = make_observation(actor.shape(), objects, arm, hand_index);
    float* degrees = read<float>("degrees", out, {1 + kSets, seen.objects});
    const nb::gil_scoped_release released;
    actor.degrees(seen, degrees);
}

void compute(Function function, const Array& x, const Array& y, const Writable& out,
             int64_t repeats) {
    const int64_t size = (int64_t)x.size();
    if (size % kLane) throw Error("x: expected a multiple of 16, got " + std::to_string(size));
    const float *a = read<float>("x", x, {size}), *b = read<float>("y", y, {size});
    level().kernel->elementwise(function, a, b, read<float>("out", out, {size}), size, repeats);
}

void multiply(const Array& a, const Array& b, const Writable& out) {
    if (a.ndim() != 2 || b.ndim() != 2 || b.shape(1) % kLane)
        throw Error("expected a [rows, depth] and b [depth, a multiple of 16], got " +
                    text_of(shape_of(a)) + " and " + text_of(shape_of(b)));
    const Shape left = shape_of(a), right{left[1], (int64_t)b.shape(1)};
    const float *x = read<float>("a", a, left), *y = read<float>("b", b, right);
    float* z = read<float>("out", out, {left[0], right[1]});
    check_aligned("b", y), check_aligned("out", z);
    level().kernel->product(left[0], right[1], left[1], x, y, z);
}

void bind_network(nb::module_& m) {
    nb::class_<Network>(m, "Network", "What the engine is told of an actor or a critic.")
        .def_static("trunk", make_trunk, nb::kw_only(), "hidden"_a, "attention"_a, "arm_features"_a,
                    "actions"_a, "scale"_a, "group_sizes"_a, "words"_a, "detectors"_a,
                    "hide_properties"_a, "critic"_a, "self_weight"_a, "relations"_a = 0,
                    "min_max"_a = false, "roles"_a = false, "avoids"_a = false, "upper_layers"_a = 0,
                    "A programmable one. `scale`: of each feature of an object. `words`: the first "
                    "feature of each one's value, its numbers as scaled, and how near is near; no "
                    "numbers: true of nothing. `relations`: 0 where programs ask for one alone. "
                    "`min_max`: what AND and OR of degrees are, of an actor that doesn't learn. `roles`: "
                    "programs say what is moved and where to; `avoids`: what is avoided.")
        .def_static("canonical", make_canonical, nb::kw_only(), "hidden"_a, "arm_features"_a,
                    "actions"_a, "scale"_a, "group_sizes"_a, "words"_a, "slots"_a, "critic"_a,
                    "An MLP. `slots`: the words, one of each group, of the block that fills each.")
        .def_ro("hidden", &Network::hidden)
        .def_ro("attention", &Network::attention)
        .def_ro("words", &Network::words)
        .def_ro("relations", &Network::relations)
        .def_ro("upper_layers", &Network::upper)
        .def_prop_ro("avoids", [](const Network& n) { return n.avoids != 0; })
        .def_ro("object_features", &Network::object_features)
        .def_ro("actions", &Network::actions)
        .def_prop_ro("detectors", [](const Network& n) { return n.detectors != 0; })
        .def_prop_ro("critic", [](const Network& n) { return n.critic != 0; })
        .def_prop_ro("is_canonical", [](const Network& n) { return n.canonical != 0; });
    nb::class_<Layout>(m, "Layout", "Offsets and sizes in a flat buffer, in floats: see layout.h.")
        .def_ro("hidden", &Layout::hidden)
        .def_ro("columns", &Layout::columns)
        .def_ro("rows", &Layout::rows)
        .def_ro("local", &Layout::local)
        .def_ro("avoid", &Layout::avoid)
        .def_ro("receiver", &Layout::receiver)
        .def_ro("sender", &Layout::sender)
        .def_ro("query", &Layout::query)
        .def_ro("context", &Layout::context)
        .def_ro("detectors", &Layout::detectors)
        .def_ro("first", &Layout::first)
        .def_ro("attention_weight", &Layout::attention_weight)
        .def_ro("relation", &Layout::relation)
        .def_ro("second", &Layout::second)
        .def_ro("second_bias", &Layout::second_bias)
        .def_ro("upper", &Layout::upper)
        .def_ro("action", &Layout::action)
        .def_ro("output", &Layout::output)
        .def_ro("output_bias", &Layout::output_bias)
        .def_ro("inputs", &Layout::inputs);
    m.def("layout_of", layout_of, "network"_a);
}

View view(const Buffer& buffer, nb::handle owner) {
    return View(buffer.data(), {(size_t)buffer.size()}, owner);
}

template <Buffer Trained::* buffer>
View buffer_of(nb::handle_t<Trained> trained) {
    return view(nb::cast<const Trained&>(trained).*buffer, trained);
}

void bind_engine(nb::module_& m) {
    nb::class_<Trained>(m, "Trained", "A network's flat buffers, float32, as views.")
        .def_prop_ro("parameters", buffer_of<&Trained::parameters>)
        .def_prop_ro("target", buffer_of<&Trained::target>)
        .def_prop_ro("gradient", buffer_of<&Trained::gradient>)
        .def_prop_ro("first_moment", buffer_of<&Trained::first_moment>)
        .def_prop_ro("second_moment", buffer_of<&Trained::second_moment>);
    nb::class_<Metrics>(m, "Metrics", "Of one update; `largest_part`: see LARGEST_PART.")
        .def_ro("critic_loss", &Metrics::critic_loss)
        .def_ro("mean_q", &Metrics::mean_q)
        .def_ro("actor_gradient_norm", &Metrics::actor_gradient_norm)
        .def_ro("largest_part", &Metrics::largest_part);
    nb::class_<Engine>(m, "Engine", "One DPG update of actor and critic.")
        .def(
            "__init__",
            [](Engine* made, const Network& actor, const Network& critic, double actor_rate,
               double critic_rate, double beta1, double beta2, double epsilon, double clip,
               double action_penalty, double detector_gain, double sparsity, double free_from,
               bool detector_arm, bool detector_bias, int threads) {
                const Settings settings{actor_rate,    critic_rate, beta1,     beta2,
                                        epsilon,       clip,        action_penalty,
                                        detector_gain, sparsity,    free_from, detector_arm,
                                        detector_bias};
                new (made) Engine(actor, critic, settings, threads);
            },
            "actor"_a, "critic"_a, nb::kw_only(), "actor_rate"_a, "critic_rate"_a, "beta1"_a,
            "beta2"_a, "epsilon"_a, "clip"_a, "action_penalty"_a, "detector_gain"_a, "sparsity"_a,
            "free_from"_a, "detector_arm"_a, "detector_bias"_a, "threads"_a)
        .def_prop_ro("actor", &Engine::actor, nb::rv_policy::reference_internal)
        .def_prop_ro("critic", &Engine::critic, nb::rv_policy::reference_internal)
        .def(
            "set_programs",
            [](Engine& engine, const Array& op, const Array& a, const Array& b, const Array& relation,
               const Array& moved, const Array& target, const Array& avoided) {
                engine.set_programs(make_programs(op, a, b, relation, moved, target, avoided));
            },
            nb::kw_only(), "op"_a, "a"_a, "b"_a, "relation"_a, "moved"_a, "target"_a, "avoided"_a,
            "What rows of batches mean: compiled programs by the fields of their record, "
            "instructions [P, L] and all else [P], int32.")
        .def(
            "set_targets",
            [](Engine& engine, const Array& words) { engine.set_targets(make_targets(engine.actor().shape, words)); },
            "words"_a, "The same for canonical networks: each target's words, [P, groups] int32.")
        .def(
            "update",
            [](Engine& engine, const Array& objects, const Array& arm, const Array& action,
               const Array& next_objects, const Array& next_arm, const Array& program,
               const Array& reward, const Array& discount, int hand_index,
               double correction1, double correction2, double rate_share) {
                const Batch batch = make_batch(
                    engine.actor().shape, objects, arm, action, next_objects, next_arm, program,
                    reward, discount, hand_index, correction1, correction2, rate_share);
                const nb::gil_scoped_release released;
                return engine.update(batch);
            },
            nb::kw_only(), "objects"_a, "arm"_a, "action"_a, "next_objects"_a, "next_arm"_a,
            "program"_a, "reward"_a, "discount"_a, "hand_index"_a, "correction1"_a,
            "correction2"_a, "rate_share"_a = 1.0,
            "The corrections are of Adam's moments, 1 - beta^step; the share is of both rates.");
}

void bind_actor(nb::module_& m) {
    nb::class_<Actor>(m, "Actor", "Actions for one observation at a time.")
        .def(nb::init<const Network&>(), "network"_a)
        .def_prop_ro("parameters",
                     [](nb::handle_t<Actor> actor) {
                         return view(nb::cast<Actor&>(actor).parameters(), actor);
                     })
        .def(
            "set_program",
            [](Actor& actor, const Array& op, const Array& a, const Array& b, const Array& relation,
               const Array& moved, const Array& target, const Array& avoided) {
                actor.set_program(make_programs(op, a, b, relation, moved, target, avoided));
            },
            nb::kw_only(), "op"_a, "a"_a, "b"_a, "relation"_a, "moved"_a, "target"_a, "avoided"_a,
            "Act on one program from now on: as `Engine.set_programs`, with P = 1.")
        .def(
            "set_target",
            [](Actor& actor, const Array& words) { actor.set_target(make_targets(actor.shape(), words)); },
            "words"_a, "The same for canonical networks: the target's words, [1, groups].")
        .def("act", act, "objects"_a, "arm"_a, "hand_index"_a, "action"_a,
             "Objects [N, F], arm [A]; writes the action, [J].")
        .def("degrees", find_degrees, "objects"_a, "arm"_a, "hand_index"_a, "degrees"_a,
             "The same; writes the degrees [4, N] of p, what is moved, the target and what is avoided.");
}

// Errors of the library are Python's FusedError, which is there without the library too.
void raise_error(const std::exception_ptr& thrown, void*) {
    try {
        std::rethrow_exception(thrown);
    } catch (const Error& error) {
        const nb::object type = nb::module_::import_("pa_ros.native.errors").attr("FusedError");
        PyErr_SetString(type.ptr(), error.what());
    }
}

}  // namespace
}  // namespace pa

NB_MODULE(_fused, m) {
    using namespace pa;
    m.doc() = "The fused DPG update and actor in C++; use pa_ros.native.engine.";
    nb::set_leak_warnings(false);  // caches of Python may hold objects to the end
    nb::register_exception_translator(raise_error);
    m.attr("MAX_WORDS") = kMaxWords;
    m.attr("MAX_SLOTS") = kMaxSlots;
    m.attr("MAX_GROUPS") = kMaxGroups;
    m.attr("MAX_FEATURES") = kMaxFeatures;
    m.attr("MAX_ACTIONS") = kMaxActions;
    m.attr("MAX_NUMBERS") = kMaxNumbers;
    m.attr("MAX_PROGRAMS") = kMaxPrograms;
    m.attr("MAX_RELATIONS") = kMaxRelations;
    m.attr("LARGEST_PART") = kLargestPart;
    bind_network(m);
    bind_engine(m);
    bind_actor(m);
    m.def("level", [] { return level().name; }, "The instruction set in use.");
    m.def(
        "levels",
        [] {
            std::vector<std::pair<std::string, bool>> all;
            for (const Level& level : levels()) all.emplace_back(level.name, level.available);
            return all;
        },
        "Every instruction set it was built for, and whether this machine has it.");
    nb::enum_<Function>(m, "Function", "What `elementwise` computes.")
        .value("EXPONENTIAL", Function::exponential)
        .value("TANH", Function::tanh)
        .value("TANH_OF_SUM", Function::tanh_of_sum);
    m.def("elementwise", compute, "function"_a, "x"_a, "y"_a, "out"_a, "repeats"_a = 1,
          "out = f(x, y); tanh(a + b) is given x = e^2a / 2 and y = e^2b.");
    m.def("product", multiply, "a"_a, "b"_a, "out"_a, "out = a · b; b and out begin a line.");
}
