// Turns of single hinges by their own steps (quarters, halves, thirds), for every kind of
// module.
//
// A state of a chain has one level per hinge: its angle in steps. The *size* of a turn is the
// largest size of the modules, each scaled about its centroid and at most 1, at which the turn is
// free: no two modules share inner points on the way. Modules that touch are free. The size of a
// turn is the smallest one of a module that turns and one that rests, and that depends on their
// poses as seen from the hinge alone. So it is computed once for each such pair of poses.
//
// For two convex bodies the size in a given pose is the largest value of
//   n · d / (h_a(n) + h_b(−n))
// over the normals n of faces and the cross products of edges, where d leads from one centroid to
// the other and h is the largest projection of a body's points: the gauge of d in the Minkowski sum
// of one body and the mirrored other one. From one pose to all of an interval of the motion leads a
// bound of second order, and intervals are halved until it decides.
#include <nanobind/stl/tuple.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <queue>
#include <tuple>
#include <vector>

#include "module_bindings.hpp"
#include "vectors.hpp"

namespace foldback {

namespace {

// Maximum amount by which the size of a turn may be above the true one.
constexpr double SIZE_TOLERANCE = 1e-4;
// Rounding errors of sizes: a turn of this much less than a size is free at it.
constexpr double SIZE_ROUNDING = 1e-7;
// Poses that differ by less than 1 / POSE_STEPS in all coordinates, pitches or elements of the
// rotation, are taken for the same one.
constexpr double POSE_STEPS = 1e6;
// Offset of the rounding of poses, so that no coordinate of a lattice lies between two steps.
constexpr double POSE_SHIFT = 0.1371;
// Minimum length of the cross product of two unit edges that is tested as an axis.
constexpr double MIN_EDGE_CROSS = 1e-6;
// Half of an interval of a motion, of which it is a fraction, that is not halved again.
constexpr double MIN_INTERVAL = 1e-7;

// Largest distance of the centres of two modules, pitches, at which they count as near each other.
constexpr double NEAR_DISTANCE = 1.1;
// Size below which sizes of turns are not told apart.
constexpr double MIN_TURN_SIZE = 0.5;
// Maximum number of hinges that a search turns at once.
constexpr int MAX_TOGETHER = 3;

using Point = Vector<double>;
using Rotation = Matrix<double>;

struct Placement {
  Rotation rotation;
  Point position;
};

// A convex part of a module: corners about the module's centroid, unit vectors, and a ball around
// it.
struct ConvexPart {
  std::vector<Point> corners, normals, edges;
  Point middle;
  double radius;
};

struct RigidPiece {
  std::vector<ConvexPart> parts;
  double radius;
};

// A convex part in a pose.
struct PosedPart {
  Point centre;
  std::vector<Point> corners, normals, edges;
};

// Velocity of a body as seen from another one: turn × point + shift; a bound of its acceleration.
struct Twist {
  Point turn, shift;
  double acceleration;
  Point at(const Point &p) const { return cross(turn, p) + shift; }
};

// Size of two bodies in a pose, and the axis from the first to the second that shows it.
struct PoseSize {
  double size;
  Point axis;
};

// Size of a turn, and the place where it is smallest: two modules, and the share of the way.
struct TurnSize {
  double size;
  Index first, second;
  double place;
};

Point rotated(const Rotation &r, const Point &p) { return rotate(r, &p.x); }

double norm_of(const Point &p) { return std::sqrt(dot(p, p)); }

void place_part(const ConvexPart &part, const Placement &pose, PosedPart &placed) {
  placed.centre = pose.position;
  auto turn_all = [&](const std::vector<Point> &from, std::vector<Point> &to) {
    to.resize(from.size());
    for (std::size_t k = 0; k < from.size(); ++k) to[k] = rotated(pose.rotation, from[k]);
  };
  turn_all(part.corners, placed.corners);
  turn_all(part.normals, placed.normals);
  turn_all(part.edges, placed.edges);
}

// True if the balls around two parts stay apart, at every size, while they move by at most `slack`
// relative to each other: what separates the balls at full size separates the centroids as well.
bool balls_stay_apart(const ConvexPart &a, const Placement &pose_a, const ConvexPart &b,
                      const Placement &pose_b, double slack) {
  Point centroids = pose_b.position - pose_a.position;
  Point gap = centroids + rotated(pose_b.rotation, b.middle) - rotated(pose_a.rotation, a.middle);
  double distance = norm_of(gap);
  return distance >= a.radius + b.radius + slack && dot(gap, centroids) >= distance * slack;
}

// Smallest and largest projection of points.
std::pair<double, double> range_along(const std::vector<Point> &points, const Point &axis) {
  double low = INFINITE, high = -INFINITE;
  for (const Point &p : points) {
    double along = dot(axis, p);
    low = std::min(low, along);
    high = std::max(high, along);
  }
  return {low, high};
}

// Size of two placed parts, at most 1. To `work` the number of projected corners is added.
PoseSize size_of(const PosedPart &a, const PosedPart &b, Index &work) {
  const Index corners = static_cast<Index>(a.corners.size() + b.corners.size());
  const Point gap = b.centre - a.centre;
  PoseSize best{-INFINITE, {0.0, 0.0, 1.0}};
  auto try_axis = [&](const Point &axis) {
    work += corners;
    auto [low_a, high_a] = range_along(a.corners, axis);
    auto [low_b, high_b] = range_along(b.corners, axis);
    double along = dot(axis, gap);
    auto try_side = [&](double distance, double extent, double sign) {
      // A part beside its module's centroid may be apart at size 1 only.
      double size = distance >= extent ? 1.0 : extent > 0.0 ? distance / extent : -INFINITE;
      if (size > best.size) best = {std::min(size, 1.0), scaled(axis, sign)};
    };
    try_side(along, high_a - low_b, 1.0);
    try_side(-along, high_b - low_a, -1.0);
    return best.size >= 1.0;
  };
  for (const Point &axis : a.normals)
    if (try_axis(axis)) return best;
  for (const Point &axis : b.normals)
    if (try_axis(axis)) return best;
  for (const Point &edge_a : a.edges)
    for (const Point &edge_b : b.edges) {
      Point axis = cross(edge_a, edge_b);
      double length = norm_of(axis);
      if (length < MIN_EDGE_CROSS) continue;
      if (try_axis(scaled(axis, 1.0 / length))) return best;
    }
  return best;
}

// True if two parts of this size are apart along an axis in all of a motion of the first one by
// ±half of its time: of each corner, first what its velocity makes of its place, and then what the
// acceleration does.
bool stay_apart(const PosedPart &a, const PosedPart &b, const PoseSize &at, double size,
                const Twist &twist, double half) {
  double nearest = INFINITE, farthest = -INFINITE;
  for (const Point &corner : b.corners)
    nearest = std::min(nearest, dot(at.axis, b.centre + scaled(corner, size)));
  for (const Point &corner : a.corners) {
    Point p = a.centre + scaled(corner, size);
    farthest = std::max(farthest, dot(at.axis, p) + half * std::abs(dot(at.axis, twist.at(p))));
  }
  return nearest - farthest - 0.5 * twist.acceleration * half * half >= 0.0;
}

Rotation turn_about_z(double angle) {
  double c = std::cos(angle), s = std::sin(angle);
  return {{c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0}};
}

struct WayInterval {
  double middle, half;
};

// Size of the turn of a piece about the z axis by an angle beside a piece at rest. Below `floor`
// any value may be returned that is not below the true one.
TurnSize size_of_turn(const RigidPiece &moving, const Placement &from, const RigidPiece &resting,
                      const Placement &at, double angle, double floor, Index &work) {
  TurnSize least{1.0, -1, -1, 0.0};
  PosedPart a, b;
  Twist twist{{0.0, 0.0, angle}, {0.0, 0.0, 0.0}, 0.0};
  double arm = std::hypot(from.position.x, from.position.y) + moving.radius;
  twist.acceleration = angle * angle * arm;
  double speed = std::abs(angle) * arm, reach = moving.radius + resting.radius;
  std::vector<WayInterval> waiting;
  for (const ConvexPart &other : resting.parts) {
    place_part(other, at, b);
    for (const ConvexPart &part : moving.parts) {
      waiting.assign({{1.0, 0.0}, {0.0, 0.0}, {0.5, 0.5}});
      while (!waiting.empty()) {
        auto [middle, half] = waiting.back();
        waiting.pop_back();
        Rotation turn = turn_about_z(angle * middle);
        Placement now{multiply(turn, from.rotation), rotated(turn, from.position)};
        if (norm_of(at.position - now.position) - reach - speed * half >= 0.0 ||
            balls_stay_apart(part, now, other, at, speed * half))
          continue;
        place_part(part, now, a);
        PoseSize pose = size_of(a, b, work);
        if (pose.size < least.size) least = {pose.size, -1, -1, middle};
        if (least.size < floor) return least;
        if (half < MIN_INTERVAL || stay_apart(a, b, pose, least.size - SIZE_TOLERANCE, twist, half))
          continue;
        half *= 0.5;
        waiting.push_back({middle - half, half});
        waiting.push_back({middle + half, half});
      }
    }
  }
  return least;
}

std::uint64_t mixed(std::uint64_t x) {
  x ^= x >> 30;
  x *= 0xBF58476D1CE4E5B9ULL;
  x ^= x >> 27;
  x *= 0x94D049BB133111EBULL;
  return x ^ (x >> 31);
}

// Open-addressed hash table from 64-bit keys to numbers that refer to entries elsewhere.
class NumberTable {
 public:
  NumberTable() : numbers_(1 << 12, -1), hashes_(1 << 12) {}

  // Number of the entry with a hash for which `is_same(number)`, or −1.
  template <class Same>
  Index find(std::uint64_t hash, Same is_same) const {
    std::size_t mask = numbers_.size() - 1, at = hash & mask;
    while (numbers_[at] >= 0) {
      if (hashes_[at] == hash && is_same(numbers_[at])) return numbers_[at];
      at = (at + 1) & mask;
    }
    return -1;
  }

  void insert(std::uint64_t hash, Index number) {
    if (2 * ++used_ > numbers_.size()) grow();
    put(hash, static_cast<std::int32_t>(number));
  }

 private:
  void put(std::uint64_t hash, std::int32_t number) {
    std::size_t mask = numbers_.size() - 1, at = hash & mask;
    while (numbers_[at] >= 0) at = (at + 1) & mask;
    numbers_[at] = number;
    hashes_[at] = hash;
  }

  void grow() {
    std::vector<std::int32_t> numbers(2 * numbers_.size(), -1);
    std::vector<std::uint64_t> hashes(2 * hashes_.size());
    numbers.swap(numbers_);
    hashes.swap(hashes_);
    for (std::size_t k = 0; k < numbers.size(); ++k)
      if (numbers[k] >= 0) put(hashes[k], numbers[k]);
  }

  std::vector<std::int32_t> numbers_;
  std::vector<std::uint64_t> hashes_;
  std::size_t used_ = 0;
};

// A piece in a pose as seen from a hinge, which runs along z through the origin.
struct SeenPose {
  std::array<std::int64_t, 13> key;
  Placement pose;
  Index piece;
  double along, away;
};

// Modules, joints and hinges of a chain: the named tuple `TurningChain` of Python.
struct TurningChain {
  View<const double, 2> anchor;   // (N − 1, 3) of each link
  View<const double, 2> axes;     // (J, 3) of each hinge, before the turns of its joint
  View<const double, 3> turn;     // (N − 1, 3, 3)
  View<const double, 2> offset;   // (N − 1, 3)
  View<const Index, 1> hinge_of;  // (N,) first hinge of each link; the last one ends them
  View<const double, 1> steps;    // (J,) radians
  View<const Index, 2> levels;    // (J, 2) lowest and highest level
  View<const Index, 1> period;    // (J,) levels of a full turn; 0 where the hinge is limited
  Hull hull;
  Index apart;  // modules fewer links apart are not checked
};

auto fields(TurningChain &c) {
  return std::tie(c.anchor, c.axes, c.turn, c.offset, c.hinge_of, c.steps, c.levels, c.period,
                  c.hull, c.apart);
}

struct Hinge {
  Index link;
  Point axis;
  double step;
  Index low, high, period;
};

struct Link {
  Point anchor, offset;
  Rotation turn;
  Index first_hinge, end_hinge;
};

std::vector<Point> points_of(View<const double, 2> rows, Index begin, Index end) {
  std::vector<Point> points;
  for (Index k = begin; k < end; ++k) points.push_back(load(rows[k].data()));
  return points;
}

// Orthonormal axes with a given z, and x towards a point where that is not on z.
Rotation frame_along(const Point &z, const Point &towards) {
  Point x = towards - scaled(z, dot(z, towards));
  if (norm_of(x) < 1e-6) {
    Point side{0.0, 0.0, 0.0};
    int least = 0;
    for (int r = 1; r < 3; ++r)
      if (std::abs(z[r]) < std::abs(z[least]) - 1e-9) least = r;
    side[least] = 1.0;
    x = side - scaled(z, dot(z, side));
  }
  x = scaled(x, 1.0 / norm_of(x));
  Point y = cross(z, x);
  return {{x.x, y.x, z.x, x.y, y.y, z.y, x.z, y.z, z.z}};
}

// A turn of a hinge by one step, and turns at the same time.
struct HingeStep {
  Index hinge, change;
};
using HingeSteps = std::vector<HingeStep>;

// Velocity of a module as seen from one before it, while hinges between them turn.
struct Approach {
  Twist twist{{0, 0, 0}, {0, 0, 0}, 0.0};
  double speed = 0.0, arm = 0.0;
  // Bound of a point's speed in an interval of the motion, in which arms may grow.
  double fastest(double half) const { return speed * arm * std::exp(half * speed); }
};

enum SearchOutcome : Index { REACHED = 0, EXHAUSTED = 1, STOPPED = 2 };

using Levels = std::vector<std::int8_t>;

void require_chain(const TurningChain &chain) {
  Index links = chain.anchor.size(), hinges = chain.axes.size();
  require(links >= 1 && chain.anchor.axis(1) == 3, "chain.anchor: (N - 1, 3)");
  require(chain.turn.shape() == std::array<Index, 3>{links, 3, 3}, "chain.turn: (N - 1, 3, 3)");
  require(chain.offset.shape() == chain.anchor.shape(), "chain.offset: (N - 1, 3)");
  require(chain.hinge_of.size() == links + 1 && chain.hinge_of[0] == 0, "chain.hinge_of: (N,)");
  for (Index l = 0; l < links; ++l)
    require(chain.hinge_of[l] <= chain.hinge_of[l + 1], "chain.hinge_of: in order");
  require(hinges >= 1 && chain.axes.axis(1) == 3, "chain.axes: (J, 3)");
  require(chain.hinge_of[links] == hinges && chain.steps.size() == hinges, "chain.steps: (J,)");
  require(chain.levels.shape() == std::array<Index, 2>{hinges, 2}, "chain.levels: (J, 2)");
  require(chain.period.size() == hinges, "chain.period: (J,)");
  for (Index k = 0; k < hinges; ++k) {
    require(chain.period[k] >= 0 && chain.period[k] <= 127, "chain.period: 0 to 127");
    require(chain.levels(k, 0) >= -127 && chain.levels(k, 1) <= 127, "chain.levels: -127 to 127");
    require(std::abs(chain.steps[k]) < 10.0, "chain.steps: less than 10 rad");
  }
  require(chain.apart >= 1, "chain.apart: 1 or more");
  require_hull(chain.hull);
}

// The turns of a chain, and what is known of the sizes of turns.
class JointTurns {
 public:
  explicit JointTurns(const TurningChain &chain);

  Index hinges() const { return static_cast<Index>(hinges_.size()); }
  Index modules() const { return static_cast<Index>(kinds_.size()); }

  // Levels after a turn by one step; false if the hinge cannot turn so far.
  bool turned(const std::int8_t *levels, Index hinge, Index change, std::int8_t *after) const {
    std::copy(levels, levels + hinges(), after);
    const Hinge &h = hinges_[hinge];
    Index level = levels[hinge] + change;
    if (h.period > 0) {
      level = ((level % h.period) + h.period) % h.period;
    } else if (level < h.low || level > h.high) {
      return false;
    }
    after[hinge] = static_cast<std::int8_t>(level);
    return true;
  }

  // Place all modules at the angles of a state, to which turns of some hinges are added.
  void place(const double *angles);
  void place(const std::int8_t *levels) {
    angles_.resize(hinges_.size());
    for (std::size_t k = 0; k < hinges_.size(); ++k)
      angles_[k] = hinges_[k].step * static_cast<double>(levels[k]);
    place(angles_.data());
  }

  // Size of the placed state at rest.
  TurnSize resting_size(double floor);

  // Size of a turn of the placed state.
  TurnSize turn_size(Index hinge, Index change, double floor);

  // Size of the turns of several hinges at once, each by `changes` steps, from a state on.
  TurnSize motion_size(const std::int8_t *levels, const HingeSteps &turns, double floor);

  Index seen_poses() const { return static_cast<Index>(seen_.size()); }
  Index known_pairs() const { return static_cast<Index>(sizes_.size()); }

  // Number of corners that were projected on axes since the beginning: what sizes cost.
  Index work() const { return work_; }

  // Sum of the least steps of all hinges from one state to another.
  Index steps_between(const std::int8_t *from, const std::int8_t *to) const {
    Index sum = 0;
    for (Index k = 0; k < hinges(); ++k) {
      Index difference = std::abs(from[k] - to[k]);
      if (hinges_[k].period > 0) difference = std::min(difference, hinges_[k].period - difference);
      sum += difference;
    }
    return sum;
  }

  // Number of pairs of placed modules, more than two links apart, that are near each other.
  Index near_pairs() const {
    Index count = 0;
    for (std::size_t i = 0; i < poses_.size(); ++i)
      for (std::size_t j = i + 3; j < poses_.size(); ++j) {
        Point gap = poses_[j].position - poses_[i].position;
        count += dot(gap, gap) < NEAR_DISTANCE * NEAR_DISTANCE;
      }
    return count;
  }

 private:
  // What is known of the turn of one seen pose beside another one.
  struct KnownSize {
    float size, place;
  };

  void add_hinge(Approach &approach, Index hinge, double rate, Index module) const;
  bool check_pair(Index i, Index j, const WayInterval &interval, Approach approach,
                  TurnSize &least);
  void see(Index hinge);
  Index seen_from_hinge(Index module);
  KnownSize pair_size(Index moving, Index resting, Index hinge, Index change);

  std::vector<RigidPiece> pieces_;
  std::vector<Link> links_;
  std::vector<Hinge> hinges_;
  std::vector<Rotation> frames_;  // of each hinge in the module before it
  std::vector<Index> kinds_, step_kinds_;
  std::vector<double> step_angles_;
  Index apart_;
  double radius_ = 0.0;
  Index work_ = 0;

  std::vector<double> angles_;
  PosedPart moving_, resting_;
  std::vector<Placement> poses_;
  std::vector<Placement> hinge_poses_;
  Index seen_hinge_ = -1;
  std::vector<Index> numbers_;  // seen pose of each module from that hinge, −1 if not yet known

  NumberTable seen_table_, size_table_;
  std::vector<SeenPose> seen_;
  std::vector<std::uint64_t> size_keys_;
  std::vector<KnownSize> sizes_;
};

JointTurns::JointTurns(const TurningChain &chain) : apart_(chain.apart) {
  require_chain(chain);
  const Hull &hull = chain.hull;
  for (Index p = 0; p < hull.pieces.size(); ++p) {
    RigidPiece piece{{}, 0.0};
    for (Index q = hull.pieces(p, 0); q < hull.pieces(p, 1); ++q) {
      piece.parts.push_back({points_of(hull.vertices, hull.parts(q, 0), hull.parts(q, 1)),
                             points_of(hull.normals, hull.parts(q, 2), hull.parts(q, 3)),
                             points_of(hull.edges, hull.parts(q, 4), hull.parts(q, 5)),
                             {0.0, 0.0, 0.0},
                             0.0});
      for (const Point &corner : piece.parts.back().corners)
        piece.radius = std::max(piece.radius, norm_of(corner));
    }
    for (ConvexPart &part : piece.parts) {
      // The ball of a piece's only part is that of the piece.
      double share = piece.parts.size() > 1 ? 1.0 / static_cast<double>(part.corners.size()) : 0.0;
      for (const Point &corner : part.corners) part.middle = part.middle + scaled(corner, share);
      for (const Point &corner : part.corners)
        part.radius = std::max(part.radius, norm_of(corner - part.middle));
    }
    radius_ = std::max(radius_, piece.radius);
    pieces_.push_back(std::move(piece));
  }
  for (Index i = 0; i <= chain.anchor.size(); ++i) kinds_.push_back(hull.piece(i));
  for (Index l = 0; l < chain.anchor.size(); ++l) {
    links_.push_back({load(chain.anchor[l].data()), load(chain.offset[l].data()),
                      load_matrix(chain.turn[l].data()), chain.hinge_of[l], chain.hinge_of[l + 1]});
    for (Index k = chain.hinge_of[l]; k < chain.hinge_of[l + 1]; ++k) {
      Point axis = load(chain.axes[k].data());
      hinges_.push_back(
          {l, axis, chain.steps[k], chain.levels(k, 0), chain.levels(k, 1), chain.period[k]});
      frames_.push_back(frame_along(axis, scaled(links_.back().anchor, -1.0)));
      auto at = std::find(step_angles_.begin(), step_angles_.end(), chain.steps[k]);
      step_kinds_.push_back(at - step_angles_.begin());
      if (at == step_angles_.end()) step_angles_.push_back(chain.steps[k]);
    }
  }
  poses_.resize(kinds_.size());
  hinge_poses_.resize(hinges_.size());
  numbers_.resize(kinds_.size());
}

void JointTurns::place(const double *angles) {
  seen_hinge_ = -1;
  poses_[0] = {{{1, 0, 0, 0, 1, 0, 0, 0, 1}}, {0, 0, 0}};
  for (std::size_t l = 0; l < links_.size(); ++l) {
    const Link &link = links_[l];
    Placement frame = poses_[l];
    frame.position = frame.position + rotated(frame.rotation, link.anchor);
    for (Index k = link.first_hinge; k < link.end_hinge; ++k) {
      hinge_poses_[k] = {multiply(frame.rotation, frames_[k]), frame.position};
      frame.rotation = multiply(frame.rotation, rodrigues(&hinges_[k].axis.x, angles[k]));
    }
    frame.rotation = multiply(frame.rotation, link.turn);
    frame.position = frame.position + rotated(frame.rotation, link.offset);
    poses_[l + 1] = frame;
  }
}

TurnSize JointTurns::resting_size(double floor) {
  TurnSize least{1.0, -1, -1, 0.0};
  PosedPart a, b;
  for (Index j = 0; j < modules(); ++j)
    for (Index i = 0; i <= j - apart_; ++i) {
      const RigidPiece &first = pieces_[kinds_[i]], &second = pieces_[kinds_[j]];
      if (norm_of(poses_[j].position - poses_[i].position) >= first.radius + second.radius)
        continue;
      for (const ConvexPart &part : first.parts)
        for (const ConvexPart &other : second.parts) {
          if (balls_stay_apart(part, poses_[i], other, poses_[j], 0.0)) continue;
          place_part(part, poses_[i], a);
          place_part(other, poses_[j], b);
          double size = size_of(a, b, work_).size;
          if (size < least.size) least = {size, i, j, 0.0};
          if (least.size < floor) return least;
        }
    }
  return least;
}

void JointTurns::see(Index hinge) {
  if (seen_hinge_ == hinge) return;
  seen_hinge_ = hinge;
  std::fill(numbers_.begin(), numbers_.end(), -1);
}

Index JointTurns::seen_from_hinge(Index module) {
  if (numbers_[module] >= 0) return numbers_[module];
  const Placement &hinge = hinge_poses_[seen_hinge_];
  Rotation back = transpose(hinge.rotation);
  SeenPose seen;
  seen.piece = kinds_[module];
  seen.pose = {multiply(back, poses_[module].rotation),
               rotated(back, poses_[module].position - hinge.position)};
  auto step_of = [](double x) {
    return static_cast<std::int64_t>(std::floor(x * POSE_STEPS + POSE_SHIFT));
  };
  for (int k = 0; k < 9; ++k) seen.key[k] = step_of(seen.pose.rotation.e[k]);
  for (int k = 0; k < 3; ++k) seen.key[9 + k] = step_of(seen.pose.position[k]);
  seen.key[12] = seen.piece;
  std::uint64_t hash = 0;
  for (std::int64_t part : seen.key) hash = mixed(hash ^ static_cast<std::uint64_t>(part)) + hash;
  Index number = seen_table_.find(hash, [&](Index k) { return seen_[k].key == seen.key; });
  if (number < 0) {
    number = static_cast<Index>(seen_.size());
    seen.along = seen.pose.position.z;
    seen.away = std::hypot(seen.pose.position.x, seen.pose.position.y);
    seen_.push_back(seen);
    seen_table_.insert(hash, number);
  }
  return numbers_[module] = number;
}

JointTurns::KnownSize JointTurns::pair_size(Index moving, Index resting, Index hinge,
                                            Index change) {
  std::uint64_t key = static_cast<std::uint64_t>(moving) << 36 |
                      static_cast<std::uint64_t>(resting) << 8 |
                      static_cast<std::uint64_t>(step_kinds_[hinge]) << 1 | (change > 0);
  std::uint64_t hash = mixed(key);
  Index number = size_table_.find(hash, [&](Index k) { return size_keys_[k] == key; });
  if (number < 0) {
    const SeenPose &a = seen_[moving], &b = seen_[resting];
    double angle = static_cast<double>(change) * hinges_[hinge].step;
    TurnSize size = size_of_turn(pieces_[a.piece], a.pose, pieces_[b.piece], b.pose, angle,
                                 MIN_TURN_SIZE, work_);
    number = static_cast<Index>(sizes_.size());
    size_keys_.push_back(key);
    sizes_.push_back({static_cast<float>(size.size), static_cast<float>(size.place)});
    size_table_.insert(hash, number);
  }
  return sizes_[number];
}

TurnSize JointTurns::turn_size(Index hinge, Index change, double floor) {
  see(hinge);
  TurnSize least{1.0, -1, -1, 0.0};
  const double reach = 2.0 * radius_;
  Index joint = hinges_[hinge].link;
  for (Index j = joint + 1; j < modules(); ++j) {
    Index moving = seen_from_hinge(j);
    for (Index i = std::min(joint, j - apart_); i >= 0; --i) {
      Index resting = seen_from_hinge(i);
      const SeenPose &a = seen_[moving], &b = seen_[resting];
      if (std::abs(a.along - b.along) >= reach || std::abs(a.away - b.away) >= reach) continue;
      KnownSize pair = pair_size(moving, resting, hinge, change);
      if (pair.size < least.size) least = {pair.size, i, j, pair.place};
      if (least.size < floor) return least;
    }
  }
  return least;
}

void JointTurns::add_hinge(Approach &approach, Index hinge, double rate, Index module) const {
  const Placement &pose = hinge_poses_[hinge];
  Point along{pose.rotation(0, 2), pose.rotation(1, 2), pose.rotation(2, 2)};
  Point turn = scaled(along, rate);
  approach.twist.turn = approach.twist.turn + turn;
  approach.twist.shift = approach.twist.shift - cross(turn, pose.position);
  approach.speed += std::abs(rate);
  double arm = norm_of(poses_[module].position - pose.position) + pieces_[kinds_[module]].radius;
  approach.arm = std::max(approach.arm, arm);
}

// Check a pair of placed modules, the second of which moves; true if they are proved to stay apart
// in the interval at nearly the smallest size so far.
bool JointTurns::check_pair(Index i, Index j, const WayInterval &interval, Approach approach,
                            TurnSize &least) {
  const RigidPiece &mover = pieces_[kinds_[j]], &other = pieces_[kinds_[i]];
  double fastest = approach.fastest(interval.half);
  double apart = norm_of(poses_[j].position - poses_[i].position) - mover.radius - other.radius;
  if (apart - interval.half * fastest >= 0.0) return true;
  // A point's acceleration is at most the sum of the hinges' speeds times its own largest speed.
  approach.twist.acceleration = approach.speed * fastest;
  bool is_proved = true;
  for (const ConvexPart &part : mover.parts)
    for (const ConvexPart &rest : other.parts) {
      if (balls_stay_apart(part, poses_[j], rest, poses_[i], interval.half * fastest)) continue;
      place_part(part, poses_[j], moving_);
      place_part(rest, poses_[i], resting_);
      PoseSize pose = size_of(moving_, resting_, work_);
      if (pose.size < least.size) least = {pose.size, i, j, interval.middle};
      is_proved = is_proved && stay_apart(moving_, resting_, pose, least.size - SIZE_TOLERANCE,
                                          approach.twist, interval.half);
    }
  return is_proved;
}

TurnSize JointTurns::motion_size(const std::int8_t *levels, const HingeSteps &turns, double floor) {
  TurnSize least{1.0, -1, -1, 0.0};
  std::vector<double> now(hinges_.size()), rates(hinges_.size(), 0.0);
  for (const HingeStep &turn : turns)
    rates[turn.hinge] += hinges_[turn.hinge].step * static_cast<double>(turn.change);
  std::vector<WayInterval> waiting{{1.0, 0.0}, {0.0, 0.0}, {0.5, 0.5}};
  while (!waiting.empty()) {
    WayInterval interval = waiting.back();
    waiting.pop_back();
    for (Index k = 0; k < hinges(); ++k)
      now[k] = hinges_[k].step * static_cast<double>(levels[k]) + interval.middle * rates[k];
    place(now.data());
    bool is_proved = true;
    for (Index j = 1; j < modules(); ++j) {
      Approach approach;
      for (Index i = j - 1; i >= 0; --i) {
        for (Index k = links_[i].first_hinge; k < links_[i].end_hinge; ++k)
          if (rates[k] != 0.0) add_hinge(approach, k, rates[k], j);
        if (approach.speed == 0.0 || j - i < apart_) continue;
        if (!check_pair(i, j, interval, approach, least)) is_proved = false;
        if (least.size < floor) return least;
      }
    }
    if (is_proved || interval.half < MIN_INTERVAL) continue;
    double half = 0.5 * interval.half;
    waiting.push_back({interval.middle - half, half});
    waiting.push_back({interval.middle + half, half});
  }
  return least;
}

std::uint64_t hash_of(const std::int8_t *levels, Index count) {
  std::uint64_t hash = 0;
  for (Index k = 0; k < count; ++k)
    hash = hash * 0x9E3779B97F4A7C15ULL + static_cast<std::uint64_t>(levels[k] + 64);
  return mixed(hash);
}

// States that a search has seen, each once, with the turn that led there.
class StateList {
 public:
  explicit StateList(Index hinges) : hinges_(hinges) {}

  // Number of a state, and whether it is new.
  std::pair<Index, bool> enter(const std::int8_t *levels, Index parent) {
    std::uint64_t hash = hash_of(levels, hinges_);
    Index number = table_.find(
        hash, [&](Index k) { return std::equal(levels, levels + hinges_, (*this)[k]); });
    if (number >= 0) return {number, false};
    number = size();
    levels_.insert(levels_.end(), levels, levels + hinges_);
    parents_.push_back(static_cast<std::int32_t>(parent));
    depths_.push_back(parent < 0 ? 0 : depths_[parent] + 1);
    table_.insert(hash, number);
    return {number, true};
  }

  Index find(const std::int8_t *levels) const {
    return table_.find(hash_of(levels, hinges_),
                       [&](Index k) { return std::equal(levels, levels + hinges_, (*this)[k]); });
  }

  Index size() const { return static_cast<Index>(parents_.size()); }
  const std::int8_t *operator[](Index k) const { return levels_.data() + k * hinges_; }
  Index depth(Index k) const { return depths_[k]; }

  // Levels of the states from the first one to this one.
  std::vector<std::int8_t> way_to(Index k) const {
    std::vector<Index> numbers;
    for (; k >= 0; k = parents_[k]) numbers.push_back(k);
    std::vector<std::int8_t> way;
    for (auto n = numbers.rbegin(); n != numbers.rend(); ++n)
      way.insert(way.end(), (*this)[*n], (*this)[*n] + hinges_);
    return way;
  }

  std::vector<std::int8_t> take_levels() { return std::move(levels_); }

 private:
  Index hinges_;
  std::vector<std::int8_t> levels_;
  std::vector<std::int32_t> parents_, depths_;
  NumberTable table_;
};

// What a search tries first, and where it ends: the named tuple `TurnSearch` of Python.
struct TurnSearch {
  double size, min_size;  // of the modules: first, and as small as need be
  double depth_weight;    // of a turn made; one that is left counts 1
  double near_weight;     // of a pair of modules near each other
  Index together;         // hinges that turn at once where no single one leads on
  Index max_states, max_motions;
  Index max_work;  // corners that are projected on axes; 0 for no limit
  Index seed;
};

auto fields(TurnSearch &s) {
  return std::tie(s.size, s.min_size, s.depth_weight, s.near_weight, s.together, s.max_states,
                  s.max_motions, s.max_work, s.seed);
}

// Search from a state for a goal, nearest states first. Where no turn leads on, several hinges are
// turned at once, and if that does not lead on either, the size is reduced to that of the largest
// turn that was not free. So the goal is reached at the largest size for which it can be.
class StateSearch {
 public:
  StateSearch(JointTurns &turns, const std::int8_t *start, const std::int8_t *goal,
              const TurnSearch &limits)
      : turns_(turns),
        hinges_(turns.hinges()),
        goal_(goal),
        limits_(limits),
        states_(turns.hinges()),
        size_(limits.size),
        first_work_(turns.work()),
        random_(mixed(static_cast<std::uint64_t>(limits.seed) + 1)),
        before_(turns.hinges()),
        after_(turns.hinges()) {
    enter(start, -1);
  }

  SearchOutcome run() {
    while (reached_ < 0) {
      if (states_.size() >= limits_.max_states || is_over()) return STOPPED;
      if (!waiting_.empty()) {
        Index state = waiting_.top().state;
        waiting_.pop();
        turn_one(state);
      } else if (!turn_several() && !shrink()) {
        return EXHAUSTED;
      }
    }
    return REACHED;
  }

  nanobind::object result(SearchOutcome outcome) {
    std::vector<std::int8_t> way = states_.way_to(reached_ >= 0 ? reached_ : nearest_), all;
    Index count = states_.size(), turns = static_cast<Index>(way.size()) / hinges_;
    if (outcome == EXHAUSTED) all = states_.take_levels();
    Index rows = static_cast<Index>(all.size()) / hinges_;
    double next = deferred_.empty() ? next_size_ : std::max(next_size_, deferred_.top().size);
    return named_tuple("TurnSearchResult", static_cast<Index>(outcome),
                       owned_array(std::move(way), {turns, hinges_}),
                       owned_array(std::move(all), {rows, hinges_}), count, tried_, motions_,
                       turns_.work() - first_work_, size_, next);
  }

 private:
  // True if the motions or the work of the search are used up.
  bool is_over() const {
    return motions_ > limits_.max_motions ||
           (limits_.max_work > 0 && turns_.work() - first_work_ > limits_.max_work);
  }

  struct Waiting {
    float score;
    std::uint32_t order;
    Index state;
    bool operator<(const Waiting &other) const {
      return score != other.score ? score > other.score : order > other.order;
    }
  };

  // A turn that is free for smaller modules only.
  struct Deferred {
    double size;
    Index state;
    HingeStep turn;
    bool operator<(const Deferred &other) const { return size < other.size; }
  };

  void enter(const std::int8_t *levels, Index parent) {
    auto [number, is_new] = states_.enter(levels, parent);
    if (!is_new) return;
    Index steps = turns_.steps_between(levels, goal_);
    if (steps < nearest_steps_) {
      nearest_steps_ = steps;
      nearest_ = number;
    }
    if (steps == 0) reached_ = number;
    double score = static_cast<double>(steps) +
                   limits_.depth_weight * static_cast<double>(states_.depth(number));
    if (limits_.near_weight != 0.0) {
      turns_.place(levels);
      score += limits_.near_weight * static_cast<double>(turns_.near_pairs());
    }
    random_ = mixed(random_ + 0x9E3779B97F4A7C15ULL);
    waiting_.push({static_cast<float>(score), static_cast<std::uint32_t>(random_), number});
  }

  // Try all turns of single hinges from a state.
  void turn_one(Index state) {
    std::copy(states_[state], states_[state] + hinges_, before_.begin());
    fresh_.clear();
    turns_.place(before_.data());
    for (Index hinge = 0; hinge < hinges_; ++hinge)
      for (Index change : {-1, 1}) {
        if (!turns_.turned(before_.data(), hinge, change, after_.data())) continue;
        if (states_.find(after_.data()) >= 0) continue;
        if (is_over()) return;
        ++tried_;
        double floor = std::min(std::max(next_size_, limits_.min_size), size_);
        double size = turns_.turn_size(hinge, change, floor).size;
        if (size >= size_ - SIZE_ROUNDING) {
          fresh_.push_back(after_);
        } else if (size >= limits_.min_size) {
          deferred_.push({size, state, {hinge, change}});
        } else {
          next_size_ = std::max(next_size_, size);
        }
      }
    for (const Levels &levels : fresh_) enter(levels.data(), state);
  }

  // Turn two hinges at once, or three, from states from which that was not tried; false if it
  // leads nowhere.
  bool turn_several() {
    for (count_ = 2; count_ <= limits_.together; ++count_)
      for (Index &next = next_states_[count_ - 2]; next < states_.size();) {
        std::copy(states_[next], states_[next] + hinges_, before_.begin());
        HingeSteps turns;
        choose(next++, turns, 0);
        if (!waiting_.empty() || is_over()) return true;
      }
    return false;
  }

  // Add hinges to some turns, from one on, and try those that are complete.
  void choose(Index state, HingeSteps &turns, Index first) {
    if (static_cast<Index>(turns.size()) == count_) return try_motion(state, turns);
    for (Index hinge = first; hinge < hinges_; ++hinge)
      for (Index change : {-1, 1}) {
        turns.push_back({hinge, change});
        choose(state, turns, hinge + 1);
        turns.pop_back();
      }
  }

  void try_motion(Index state, const HingeSteps &turns) {
    if (is_over()) return;
    Levels levels = before_;
    for (const HingeStep &turn : turns) {
      if (!turns_.turned(levels.data(), turn.hinge, turn.change, after_.data())) return;
      levels = after_;
    }
    if (states_.find(levels.data()) >= 0) return;
    turns_.place(levels.data());
    if (turns_.resting_size(size_ - SIZE_ROUNDING).size < size_ - SIZE_ROUNDING) return;
    ++motions_;
    if (turns_.motion_size(before_.data(), turns, size_ - SIZE_ROUNDING).size >=
        size_ - SIZE_ROUNDING)
      enter(levels.data(), state);
  }

  // Reduce the size to that of the largest turn that was not free, and make all turns that are free
  // now.
  bool shrink() {
    while (!deferred_.empty()) {
      Deferred next = deferred_.top();
      if (!waiting_.empty() && next.size < size_ - SIZE_ROUNDING) break;
      deferred_.pop();
      turns_.turned(states_[next.state], next.turn.hinge, next.turn.change, after_.data());
      if (states_.find(after_.data()) >= 0) continue;
      size_ = std::min(size_, next.size);
      enter(Levels(after_).data(), next.state);
    }
    return !waiting_.empty();
  }

  JointTurns &turns_;
  const Index hinges_;
  const std::int8_t *goal_;
  const TurnSearch limits_;
  StateList states_;
  std::priority_queue<Waiting> waiting_;
  std::priority_queue<Deferred> deferred_;
  double size_, next_size_ = 0.0;
  const Index first_work_;
  Index nearest_ = 0, nearest_steps_ = INT64_MAX, reached_ = -1, tried_ = 0, motions_ = 0;
  Index count_ = 2, next_states_[MAX_TOGETHER - 1] = {};
  std::uint64_t random_;
  Levels before_, after_;
  std::vector<Levels> fresh_;
};

// Entries of a table of turns that are no numbers of states.
enum NoState : std::int32_t { BLOCKED = -1, BEYOND_STOP = -2, NOT_LISTED = -3 };

// What each turn of each of some states leads to.
nanobind::object turn_table(JointTurns &turns, View<const std::int8_t, 2> levels, double size) {
  const Index count = levels.size(), hinges = turns.hinges();
  StateList states(hinges);
  for (Index s = 0; s < count; ++s) states.enter(levels[s].data(), -1);
  require(states.size() == count, "states: all different");
  std::vector<std::int32_t> next;
  std::vector<std::int16_t> modules;
  std::vector<double> places;
  Levels after(hinges);
  for (Index s = 0; s < count; ++s) {
    turns.place(levels[s].data());
    for (Index hinge = 0; hinge < hinges; ++hinge)
      for (Index change : {-1, 1}) {
        TurnSize turn{1.0, -1, -1, 0.0};
        Index number = BEYOND_STOP;
        if (turns.turned(levels[s].data(), hinge, change, after.data())) {
          turn = turns.turn_size(hinge, change, MIN_TURN_SIZE);
          number = states.find(after.data());
          if (turn.size < size - SIZE_ROUNDING) {
            number = BLOCKED;
          } else if (number < 0) {
            number = NOT_LISTED;
          }
        }
        next.push_back(static_cast<std::int32_t>(number));
        modules.push_back(static_cast<std::int16_t>(turn.first));
        modules.push_back(static_cast<std::int16_t>(turn.second));
        places.push_back(turn.place);
      }
  }
  return named_tuple("TurnTable", owned_array(std::move(next), {count, hinges, 2}),
                     owned_array(std::move(modules), {count, hinges, 2, 2}),
                     owned_array(std::move(places), {count, hinges, 2}));
}

HingeSteps turns_of(View<const Index, 1> hinges, View<const Index, 1> changes, Index count) {
  require(hinges.size() == changes.size(), "hinges, changes: (T,)");
  HingeSteps turns;
  for (Index t = 0; t < hinges.size(); ++t) {
    require(hinges[t] >= 0 && hinges[t] < count, "hinges: 0 to J - 1");
    require(changes[t] == 1 || changes[t] == -1, "changes: -1 or 1");
    turns.push_back({hinges[t], changes[t]});
  }
  return turns;
}

nanobind::object search_turns(JointTurns &turns, View<const std::int8_t, 1> start,
                              View<const std::int8_t, 1> goal, TurnSearch limits) {
  require(start.size() == turns.hinges() && goal.size() == start.size(), "start, goal: (J,)");
  require(limits.together >= 1 && limits.together <= MAX_TOGETHER, "search.together: 1 to 3");
  require(limits.max_states >= 1 && limits.max_states < (1 << 30), "search.max_states: 1 to 2^30");
  require(limits.max_work >= 0, "search.max_work: 0 or more");
  require(limits.min_size >= MIN_TURN_SIZE && limits.size <= 1.0, "search.size: 0.5 to 1");
  StateSearch search(turns, start.data(), goal.data(), limits);
  return search.result(search.run());
}

}  // namespace

void bind_joint_turns(nanobind::module_ &m) {
  namespace nb = nanobind;
  m.attr("SIZE_TOLERANCE") = SIZE_TOLERANCE;
  m.attr("MIN_TURN_SIZE") = MIN_TURN_SIZE;
  nb::class_<JointTurns>(m, "JointTurns", "Turns of the hinges of a chain, and their sizes.")
      .def(
          "__init__", [](JointTurns *self, TurningChain chain) { new (self) JointTurns(chain); },
          nb::arg("chain"))
      .def(
          "resting_size",
          [](JointTurns &self, View<const std::int8_t, 1> levels) {
            require(levels.size() == self.hinges(), "levels: (J,)");
            self.place(levels.data());
            TurnSize size = self.resting_size(0.0);
            return std::make_tuple(size.size, size.first, size.second);
          },
          nb::arg("levels"),
          "Return the largest size at which a state is free, at most 1, and the two modules.")
      .def(
          "motion_size",
          [](JointTurns &self, View<const std::int8_t, 1> levels, View<const Index, 1> hinges,
             View<const Index, 1> changes) {
            require(levels.size() == self.hinges(), "levels: (J,)");
            HingeSteps turns = turns_of(hinges, changes, self.hinges());
            TurnSize size = self.motion_size(levels.data(), turns, MIN_TURN_SIZE);
            return std::make_tuple(size.size, size.first, size.second, size.place);
          },
          nb::arg("levels"), nb::arg("hinges"), nb::arg("changes"),
          "Return the largest size at which turns at once are free, the two modules and the place.")
      .def(
          "turn_size",
          [](JointTurns &self, View<const std::int8_t, 1> levels, Index hinge, Index change) {
            require(levels.size() == self.hinges(), "levels: (J,)");
            require(hinge >= 0 && hinge < self.hinges(), "hinge: 0 to J - 1");
            require(change == 1 || change == -1, "change: -1 or 1");
            self.place(levels.data());
            TurnSize size = self.turn_size(hinge, change, MIN_TURN_SIZE);
            return std::make_tuple(size.size, size.first, size.second, size.place);
          },
          nb::arg("levels"), nb::arg("hinge"), nb::arg("change"),
          "Return the largest size at which a turn is free, the two modules and the place.")
      .def("search", search_turns, nb::arg("start"), nb::arg("goal"), nb::arg("limits"),
           "Search for turns from a state to a goal.")
      .def(
          "turn_table",
          [](JointTurns &self, View<const std::int8_t, 2> states, double size) {
            require(states.axis(1) == self.hinges(), "states: (S, J)");
            return turn_table(self, states, size);
          },
          nb::arg("states"), nb::arg("size"), "Return what each turn of some states leads to.");
}

}  // namespace foldback
