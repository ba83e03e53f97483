// Steps of hinges between the windows of a motion.
#include <algorithm>
#include <cmath>

#include "bindings.hpp"

namespace foldback {

namespace {

// Angles of hinges in the windows of a motion, see `planner.motion.motion.Motion`.
struct WindowAngles {
  View<const Index, 1> first, offsets;
  View<const float, 1> angles;
  View<const double, 1> folded;

  double at(Index frame, Index hinge) const {
    if (hinge < first[frame]) return folded[hinge];
    Index place = offsets[frame] + hinge - first[frame];
    return place < offsets[frame + 1] ? static_cast<double>(angles[place]) : 0.0;
  }
  Index end(Index frame) const { return first[frame] + offsets[frame + 1] - offsets[frame]; }
};

// Write the largest hinge step between every frame and the next, and how many hinges take part:
// with a step of more than a fraction of the largest.
void window_steps(View<const Index, 1> first, View<const Index, 1> offsets,
                  View<const float, 1> angles, View<const double, 1> folded, double fraction,
                  View<double, 1> largest, View<Index, 1> moving) {
  const WindowAngles windows{first, offsets, angles, folded};
  require(offsets.size() == first.size() + 1, "offsets: (F + 1,)");
  require(largest.size() == std::max<Index>(0, first.size() - 1) && moving.size() == largest.size(),
          "largest, moving: (F − 1,)");
  for (Index k = 0; k < first.size(); ++k)
    require(first[k] >= 0 && offsets[k] >= 0 && offsets[k] <= offsets[k + 1] &&
                offsets[k + 1] <= angles.size() && windows.end(k) <= folded.size(),
            "first, offsets: windows of the chain's hinges");
  for (Index k = 0; k + 1 < first.size(); ++k) {
    const Index low = std::min(first[k], first[k + 1]);
    const Index high = std::max(windows.end(k), windows.end(k + 1));
    auto step = [&](Index hinge) {
      return std::abs(windows.at(k + 1, hinge) - windows.at(k, hinge));
    };
    double most = 0.0;
    for (Index hinge = low; hinge < high; ++hinge) most = std::max(most, step(hinge));
    Index count = 0;
    for (Index hinge = low; most > 0.0 && hinge < high; ++hinge)
      count += step(hinge) > fraction * most;
    largest[k] = most;
    moving[k] = count;
  }
}

}  // namespace

void bind_window_steps(nanobind::module_ &m) {
  namespace nb = nanobind;
  m.def("window_steps", window_steps, nb::arg("first"), nb::arg("offsets"), nb::arg("angles"),
        nb::arg("folded"), nb::arg("fraction"), nb::arg("largest"), nb::arg("moving"),
        "Write the largest hinge step between frames, and how many hinges take part.");
}

}  // namespace foldback
