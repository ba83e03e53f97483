// Distance of two configurations of a chain that is folded, then bent, then straight.
#include <algorithm>
#include <cmath>

#include "bindings.hpp"
#include "vectors.hpp"

namespace foldback {

// The named tuple `BentWindow` of Python.
struct BentWindow {
  Index first;
  View<const double, 1> angles;
  View<const double, 2> centres;
  View<const double, 1> along;
};
static auto fields(BentWindow &w) { return std::tie(w.first, w.angles, w.centres, w.along); }

namespace {

// The largest difference of an angle of two windows, whose joints have K hinges each.
double largest_turn(const BentWindow &a, const BentWindow &b, View<const double, 1> folded,
                    Index K) {
  auto angle = [&](const BentWindow &window, Index hinge) {
    const Index place = hinge - K * window.first;
    if (place < 0) return folded[hinge];
    return place < window.angles.size() ? window.angles[place] : 0.0;
  };
  const Index end = std::max(K * a.first + a.angles.size(), K * b.first + b.angles.size());
  double largest = 0.0;
  for (Index hinge = K * std::min(a.first, b.first); hinge < end; ++hinge)
    largest = std::max(largest, std::abs(angle(a, hinge) - angle(b, hinge)));
  return largest;
}

// The largest distance of a module of both windows.
double largest_distance(const BentWindow &a, const BentWindow &b) {
  const Index high = std::min(a.first + a.centres.size(), b.first + b.centres.size());
  double largest = 0.0;
  for (Index i = std::max(a.first, b.first); i < high; ++i) {
    const Vector<double> gap =
        load(a.centres[i - a.first].data()) - load(b.centres[i - b.first].data());
    largest = std::max(largest, dot(gap, gap));
  }
  return std::sqrt(largest);
}

void require_window(const BentWindow &window, View<const double, 1> folded, Index K) {
  require(window.first >= 0 && K * window.first + window.angles.size() <= folded.size(),
          "window: hinges of the chain");
  require(window.centres.axis(1) == 3, "window.centres: (m, 3)");
  require(window.along.size() == 3, "window.along: (3,)");
}

}  // namespace

void bind_window_distances(nanobind::module_ &m) {
  namespace nb = nanobind;
  m.def(
      "window_distances",
      [](BentWindow a, BentWindow b, View<const double, 1> folded, Index hinges) {
        require(hinges > 0, "hinges: positive");
        require_window(a, folded, hinges);
        require_window(b, folded, hinges);
        return nb::make_tuple(largest_turn(a, b, folded, hinges), largest_distance(a, b),
                              dot(load(a.along.data()), load(b.along.data())));
      },
      nb::arg("a"), nb::arg("b"), nb::arg("folded"), nb::arg("hinges"),
      "Return the largest turn and distance between two windows, and the cosine of the rods'.");
}

}  // namespace foldback
