// Time-optimal scalings of motion along a path, with bounds of every hinge.
//
// With bounds of speed and acceleration: reachability analysis over x = ṡ² at the knots of a grid
// (Pham, Pham: A new approach to time-optimal path parameterization based on reachability analysis,
// 2018), with s̈ = (x₊ − x) / 2Δ constant from one knot to the next. The path is quadratic in s
// there, so every acceleration q' s̈ + q'' ṡ² is linear in s: bounds that hold at both knots hold
// between them. With bounds of torque: a forward and a backward pass.
#include <algorithm>
#include <cmath>
#include <cstring>
#include <vector>

#include "bindings.hpp"
#include "vectors.hpp"

namespace foldback {

namespace {

// Maximum number of iterations in the search, by tangents, of the largest squared path speed from
// which the motion can still go on within its bounds. With fewer, the speed found would lie
// slightly above it.
constexpr int MAX_TANGENT_CUTS = 100;
// Amount by which the lower bound of a squared path speed may exceed its upper bound before no
// speed counts as allowed, relative to that speed; rounding can cause as much.
constexpr double FEASIBILITY_TOLERANCE = 1e-12;
// Minimum fraction of a joint's torque limit that is left for acceleration along the path, even if
// centrifugal terms take more.
constexpr double MIN_TORQUE_FRACTION = 0.05;
// Ratio |b| / |a| below which an acceleration constraint |a x + b x₊| ≤ limit on the squared path
// speeds x at a grid point and x₊ at the next one counts as a bound of x alone: dividing by b would
// be inexact.
constexpr double MIN_SLOPE = 1e-7;
// Minimum torque per path acceleration, as a fraction of the torque limit, that is used to bound
// that acceleration: it avoids a division by zero for joints at rest along the path.
constexpr double MIN_INERTIA = 1e-12;

// A path in N cells: the slopes q' of J hinges at both knots of a cell lie between two rows.
struct PathCells {
  View<const double, 2> slopes;      // (K, J)
  View<const Index, 1> left, right;  // (N,) rows of `slopes`
  View<const double, 2> fractions;   // (N, 2) from the left to the right one at both knots
  View<const double, 1> lengths;     // (N,) in s
  Index size() const { return lengths.size(); }
};

// A bound of x₊ at the next knot and its derivative by x at this one.
struct Bound {
  double value, slope;
};

// Range of x₊ that x allows, and the upper bound of x itself.
struct NextRange {
  Bound low{-INFINITE, 0.0}, high{INFINITE, 0.0};
  double x_bound = INFINITE;
};

// One cell of the path at a time, with the slopes q' at its knots.
class SpeedCell {
 public:
  explicit SpeedCell(const PathCells &path)
      : path_(path), start_(path.slopes.axis(1)), end_(path.slopes.axis(1)) {}

  void move_to(Index k) {
    View<const double, 1> left = path_.slopes[path_.left[k]], right = path_.slopes[path_.right[k]];
    double first = path_.fractions(k, 0), second = path_.fractions(k, 1);
    for (std::size_t j = 0; j < start_.size(); ++j) {
      double change = right[j] - left[j];
      start_[j] = left[j] + first * change;
      end_[j] = left[j] + second * change;
    }
    length_ = path_.lengths[k];
  }

  // Largest |q'|. It is at a knot, so that it holds between knots too.
  double steepest() const {
    double steepest = 0.0;
    for (std::size_t j = 0; j < start_.size(); ++j)
      steepest = std::max({steepest, std::abs(start_[j]), std::abs(end_[j])});
    return steepest;
  }

  // Range of x₊ at the next knot that x at this one allows. Each hinge has a row
  // |a x + b x₊| ≤ acceleration at either knot.
  NextRange next_range(double acceleration, double x) const {
    NextRange range;
    double half = 0.5 / length_;
    for (std::size_t j = 0; j < start_.size(); ++j) {
      double curvature = (end_[j] - start_[j]) / length_;
      add_row(curvature - half * start_[j], half * start_[j], acceleration, x, range);
      add_row(-half * end_[j], curvature + half * end_[j], acceleration, x, range);
    }
    return range;
  }

  // The largest of 0 … x from which one of 0 … x_next can be reached. The size of the range at the
  // next knot is a concave function of x, and not negative at 0: cuts along its tangents lead down
  // to its root.
  double controllable(double acceleration, double x, double x_next) const {
    x = std::min(x, next_range(acceleration, 0.0).x_bound);
    for (int cut = 0; cut < MAX_TANGENT_CUTS; ++cut) {
      auto [low, high, x_bound] = next_range(acceleration, x);
      if (low.value < 0.0) low = {0.0, 0.0};
      if (high.value > x_next) high = {x_next, 0.0};
      double width = high.value - low.value;
      if (width >= -FEASIBILITY_TOLERANCE * (x + x_next) || high.slope >= low.slope) break;
      x = std::max(0.0, x - width / (high.slope - low.slope));
    }
    return x;
  }

 private:
  static void add_row(double a, double b, double acceleration, double x, NextRange &range) {
    if (std::abs(b) <= MIN_SLOPE * std::abs(a)) {
      if (a != 0.0) range.x_bound = std::min(range.x_bound, acceleration / std::abs(a));
      return;
    }
    double slope = -a / b, width = acceleration / std::abs(b);
    if (slope * x + width < range.high.value) range.high = {slope * x + width, slope};
    if (slope * x - width > range.low.value) range.low = {slope * x - width, slope};
  }

  const PathCells &path_;
  std::vector<double> start_, end_;
  double length_ = 0.0;
};

auto fastest_profile(View<const double, 2> slopes, View<const Index, 1> left,
                     View<const Index, 1> right, View<const double, 2> fractions,
                     View<const double, 1> lengths, double speed, double acceleration) {
  const PathCells path{slopes, left, right, fractions, lengths};
  Index count = path.size();
  require(left.size() == count && right.size() == count, "left, right: (N,)");
  require(fractions.shape() == std::array<Index, 2>{count, 2}, "fractions: (N, 2)");
  for (Index k = 0; k < count; ++k) {
    require(left[k] >= 0 && left[k] < slopes.size(), "left: rows of slopes");
    require(right[k] >= 0 && right[k] < slopes.size(), "right: rows of slopes");
    require(lengths[k] > 0.0, "lengths: positive");
  }
  std::vector<double> ceiling(count + 1, INFINITE), x(count + 1);
  SpeedCell cell(path);
  for (Index k = 0; k < count; ++k) {
    cell.move_to(k);
    double ratio = speed / cell.steepest();
    for (Index knot : {k, k + 1}) ceiling[knot] = std::min(ceiling[knot], ratio * ratio);
  }
  ceiling[0] = ceiling[count] = 0.0;
  for (Index k = count - 1; k >= 0; --k) {
    cell.move_to(k);
    ceiling[k] = cell.controllable(acceleration, ceiling[k], ceiling[k + 1]);
  }
  for (Index k = 0; k < count; ++k) {
    cell.move_to(k);
    double high = cell.next_range(acceleration, x[k]).high.value;
    x[k + 1] = std::max(0.0, std::min(high, ceiling[k + 1]));
  }
  return owned_array(std::move(x), {count + 1});
}

Lanes load_lanes(const double *numbers) {
  Lanes lanes;
  std::memcpy(&lanes, numbers, sizeof lanes);
  return lanes;
}

template <class T>
T at_least(T value, double least) {
  return value < least ? T{} + least : value;
}

template <class T>
T magnitude(T value) {
  return value < 0.0 ? -value : value;
}

// Largest ü that |τ| ≤ 1 leaves a joint where u̇² is z: τ = a ü + b u̇².
template <class T>
T acceleration_limit(T a, T b, double z) {
  return at_least(1.0 - magnitude(b) * z, MIN_TORQUE_FRACTION) /
         at_least(magnitude(a), MIN_INERTIA);
}

// Upper bound of z = u̇² one step from where it is z, with the ü = z' / 2 that all joints allow.
double reachable(View<const double, 1> a, View<const double, 1> b, double z, double step) {
  Index j = 0;
  Lanes limits = Lanes{} + INFINITE;
  for (; j + LANES <= a.size(); j += LANES) {
    Lanes limit = acceleration_limit(load_lanes(a.data() + j), load_lanes(b.data() + j), z);
    limits = limit < limits ? limit : limits;
  }
  double least = INFINITE;
  for (int lane = 0; lane < LANES; ++lane) least = std::min(least, limits[lane]);
  for (; j < a.size(); ++j) least = std::min(least, acceleration_limit(a[j], b[j], z));
  return z + 2.0 * least * step;
}

auto torque_passes(View<const double, 2> a, View<const double, 2> b, View<const double, 1> ceiling,
                   double step) {
  Index count = ceiling.size(), last = count - 1;
  require(count > 0, "ceiling: at least one sample");
  require(a.size() == count && b.shape() == a.shape(), "a, b: (U, J)");
  std::vector<double> z(ceiling.begin(), ceiling.end());
  z[0] = z[last] = 0.0;
  auto pass = [&](Index i, Index next) {
    z[next] = std::min(z[next], reachable(a[i], b[i], z[i], step));
  };
  for (Index i = 0; i < last; ++i) pass(i, i + 1);
  for (Index i = last; i > 0; --i) pass(i, i - 1);
  return owned_array(std::move(z), {count});
}

}  // namespace

void bind_speed_profiles(nanobind::module_ &m) {
  namespace nb = nanobind;
  m.def("fastest_profile", fastest_profile, nb::arg("slopes"), nb::arg("left"), nb::arg("right"),
        nb::arg("fractions"), nb::arg("lengths"), nb::arg("speed"), nb::arg("acceleration"),
        "Return the largest ṡ² at the knots that the bounds allow, at rest at both ends.");
  m.def("torque_passes", torque_passes, nb::arg("a"), nb::arg("b"), nb::arg("ceiling"),
        nb::arg("step"),
        "Return z = u̇² at even steps of a path along which the torques are τ = a ü + b u̇².");
}

}  // namespace foldback
