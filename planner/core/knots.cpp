// Simplification of closed polygons in space without a change of their knot, and their diagrams.
//
// A vertex may be removed if no other edge meets the triangle of it and its neighbours (Koniaris
// and Muthukumar 1991, Taylor 2000). A case that rounding makes uncertain counts as meeting: a step
// is left out rather than done wrongly.
#include <nanobind/stl/pair.h>

#include <algorithm>
#include <array>
#include <utility>
#include <vector>

#include "bindings.hpp"
#include "vectors.hpp"

namespace foldback {

namespace {

// Number of consecutive edges of a closed polygon in one bounding box, by which edges far from a
// triangle are skipped.
constexpr Index EDGES_PER_BOX = 24;
// Volume of a tetrahedron, relative to the cube of its extent, below which rounding may decide its
// sign when an edge is tested against a triangle: then they count as meeting.
constexpr double VOLUME_TOLERANCE = 1e-13;

using Point = Vector<double>;
using Polygon = std::vector<Point>;
using Triangle = std::array<Point, 3>;

struct Box {
  Point low, high;

  void add(const Point &point) {
    for (int k = 0; k < 3; ++k) {
      low[k] = std::min(low[k], point[k]);
      high[k] = std::max(high[k], point[k]);
    }
  }
  bool is_separate(const Box &other) const {
    for (int k = 0; k < 3; ++k)
      if (low[k] > other.high[k] || high[k] < other.low[k]) return true;
    return false;
  }
};

Index size_of(const Polygon &points) { return static_cast<Index>(points.size()); }

// Six times the signed volume of a tetrahedron.
double volume(const Point &a, const Point &b, const Point &c, const Point &d) {
  Point u = a - d, v = b - d, w = c - d;
  return u.x * (v.y * w.z - v.z * w.y) - u.y * (v.x * w.z - v.z * w.x) +
         u.z * (v.x * w.y - v.y * w.x);
}

// True if edge pq meets triangle abc, or if rounding makes it uncertain.
bool meets(const Point &p, const Point &q, const Triangle &triangle) {
  const auto &[a, b, c] = triangle;
  Box box{p, p};
  for (const Point &point : {q, a, b, c}) box.add(point);
  double extent = 0.0;
  for (int k = 0; k < 3; ++k) extent = std::max(extent, box.high[k] - box.low[k]);
  double tolerance = VOLUME_TOLERANCE * extent * extent * extent;
  double above = volume(a, b, c, p), below = volume(a, b, c, q);
  if ((above > tolerance && below > tolerance) || (above < -tolerance && below < -tolerance))
    return false;
  double u = volume(p, q, a, b), v = volume(p, q, b, c), w = volume(p, q, c, a);
  return (u >= -tolerance && v >= -tolerance && w >= -tolerance) ||
         (u <= tolerance && v <= tolerance && w <= tolerance);
}

// A closed polygon from which vertices are removed, and boxes around its edges.
class Thinning {
 public:
  explicit Thinning(Polygon points)
      : points_(std::move(points)), following_(points_.size()), boxes_(box_count()) {
    Index n = size();
    for (Index i = 0; i < n; ++i) following_[i] = (i + 1) % n;
    for (Index box = 0; box < box_count(); ++box) update_box(box);
  }

  const Polygon &points() const { return points_; }
  Index size() const { return size_of(points_); }

  // True if no edge meets a triangle, other than those that start at two vertices. An edge that
  // begins or ends in a corner of the triangle meets it there alone.
  bool is_unobstructed(const Triangle &triangle, Index first, Index second) const {
    Box extent{triangle[0], triangle[0]};
    extent.add(triangle[1]);
    extent.add(triangle[2]);
    Index last = following_[second];
    for (Index box = 0; box < box_count(); ++box) {
      if (boxes_[box].is_separate(extent)) continue;
      Index end = std::min(size(), (box + 1) * EDGES_PER_BOX);
      for (Index s = box * EDGES_PER_BOX; s < end; ++s) {
        Index e = following_[s];
        if (e < 0 || e == first || s == first || s == second || s == last) continue;
        if (!is_separate(points_[s], points_[e], extent) && meets(points_[s], points_[e], triangle))
          return false;
      }
    }
    return true;
  }

  // Remove vertex i between two others.
  void remove(Index before, Index i, Index after) {
    following_[before] = after;
    following_[i] = -1;
    // The new edge belongs to the box of its first vertex, which has to contain it.
    boxes_[before / EDGES_PER_BOX].add(points_[after]);
  }

  // Move vertex i, between two others of a polygon that has lost none.
  void move(Index before, Index i, const Point &moved) {
    points_[i] = moved;
    update_box(before / EDGES_PER_BOX);
    update_box(i / EDGES_PER_BOX);
  }

  Index following(Index i) const { return following_[i]; }

  // The vertices that were not removed, in order.
  Polygon remaining() const {
    Polygon kept;
    kept.reserve(points_.size());
    for (Index i = 0; i < size(); ++i)
      if (following_[i] >= 0) kept.push_back(points_[i]);
    return kept;
  }

 private:
  Index box_count() const { return (size() + EDGES_PER_BOX - 1) / EDGES_PER_BOX; }

  static bool is_separate(const Point &p, const Point &q, const Box &box) {
    for (int k = 0; k < 3; ++k)
      if ((p[k] > box.high[k] && q[k] > box.high[k]) || (p[k] < box.low[k] && q[k] < box.low[k]))
        return true;
    return false;
  }

  void update_box(Index box) {
    Index first = box * EDGES_PER_BOX, last = std::min(size(), first + EDGES_PER_BOX);
    boxes_[box] = {points_[last % size()], points_[last % size()]};
    for (Index i = first; i < last; ++i) boxes_[box].add(points_[i]);
  }

  Polygon points_;
  std::vector<Index> following_;  // next vertex of each one; −1 for those removed
  std::vector<Box> boxes_;        // of runs of EDGES_PER_BOX edges
};

// A closed polygon without the vertices that can be removed in one round.
Polygon without_removable(Polygon points) {
  Thinning thinning(std::move(points));
  const Polygon &vertices = thinning.points();
  Index n = thinning.size(), remaining = n, before = n - 1;
  // The vertex before the first one stays: the round ends at an edge that is still there.
  for (Index i = 0; i < n - 1 && remaining > 3; ++i) {
    Index after = thinning.following(i);
    if (thinning.is_unobstructed({vertices[before], vertices[i], vertices[after]}, before, i)) {
      thinning.remove(before, i, after);
      --remaining;
    } else {
      before = i;
    }
  }
  return thinning.remaining();
}

Polygon load_polygon(View<const double, 2> polygon) {
  require(polygon.axis(1) == 3, "polygon: (n, 3)");
  Polygon points;
  for (Index i = 0; i < polygon.size(); ++i) points.push_back(load(polygon[i].data()));
  return points;
}

auto polygon_array(const Polygon &points) {
  std::vector<double> elements(3 * points.size());
  for (Index i = 0; i < size_of(points); ++i) store(points[i], elements.data() + 3 * i);
  return owned_array(std::move(elements), {size_of(points), 3});
}

auto simplified(View<const double, 2> polygon) {
  Polygon points = load_polygon(polygon);
  while (points.size() > 3) {
    // Each round starts elsewhere, so that every vertex is tried.
    Polygon turned = points;
    std::rotate(turned.begin(), turned.end() - (size_of(turned) / 7 + 1), turned.end());
    Polygon shorter = without_removable(std::move(turned));
    if (shorter.size() == points.size()) break;
    points = std::move(shorter);
  }
  return polygon_array(points);
}

auto tightened(View<const double, 2> polygon, double pull) {
  Thinning thinning(load_polygon(polygon));
  const Polygon &points = thinning.points();
  Index n = thinning.size();
  for (Index i = 0; i < n; ++i) {
    Index before = (i + n - 1) % n, after = (i + 1) % n;
    double fraction = pull;
    for (int attempt = 0; attempt < 3; ++attempt) {
      Point middle = scaled(points[before] + points[after], 0.5);
      Point moved = points[i] + scaled(middle - points[i], fraction);
      // First the edge before turns about its start, then the one after about its end.
      if (thinning.is_unobstructed({points[before], points[i], moved}, before, i) &&
          thinning.is_unobstructed({points[after], points[i], moved}, before, i)) {
        thinning.move(before, i, moved);
        break;
      }
      fraction *= 0.5;
    }
  }
  return polygon_array(points);
}

struct Crossing {
  double first, second;  // parameters of both edges, 0 to 1
  bool is_first_above, turns_left;
};

// True if two edges cross in their projection along z.
bool cross_in_projection(const Point &a, const Point &b, const Point &c, const Point &d,
                         Crossing &out) {
  Point u = b - a, v = d - c, w = c - a;
  double across = u.x * v.y - u.y * v.x;
  if (across == 0.0) return false;
  double s = (w.x * v.y - w.y * v.x) / across;
  double t = (w.x * u.y - w.y * u.x) / across;
  if (s < 0.0 || s >= 1.0 || t < 0.0 || t >= 1.0) return false;
  out = {s, t, a.z + s * u.z > c.z + t * v.z, across > 0.0};
  return true;
}

auto crossings(View<const double, 2> polygon) {
  Polygon points = load_polygon(polygon);
  Index n = size_of(points);
  std::vector<double> parameters;
  std::vector<Index> signs;
  for (Index i = 0; i < n; ++i) {
    for (Index j = i + 2; j < n; ++j) {
      if (i == 0 && j == n - 1) continue;
      Crossing crossing;
      if (!cross_in_projection(points[i], points[(i + 1) % n], points[j], points[(j + 1) % n],
                               crossing))
        continue;
      double first = static_cast<double>(i) + crossing.first;
      double second = static_cast<double>(j) + crossing.second;
      if (!crossing.is_first_above) std::swap(first, second);
      parameters.push_back(first);
      parameters.push_back(second);
      signs.push_back(crossing.turns_left == crossing.is_first_above ? 1 : -1);
    }
  }
  Index count = static_cast<Index>(signs.size());
  return std::pair(owned_array(std::move(parameters), {count, 2}),
                   owned_array(std::move(signs), {count}));
}

// Remainder of a division by a prime, which is never negative.
Index remainder(Index value, Index prime) {
  Index rest = value % prime;
  return rest < 0 ? rest + prime : rest;
}

// Inverse modulo a prime, by Fermat's little theorem.
Index inverse_modulo(Index value, Index prime) {
  Index inverse = 1, base = value;
  for (Index power = prime - 2; power > 0; power >>= 1) {
    if (power & 1) inverse = inverse * base % prime;
    base = base * base % prime;
  }
  return inverse;
}

Index determinant(View<const Index, 2> matrix, Index prime) {
  Index n = matrix.size();
  require(matrix.axis(1) == n, "matrix: (n, n)");
  require(prime >= 2 && prime < (Index{1} << 31), "prime: 2 to 2^31 - 1");
  Array<Index, 2> rows({n, n});
  for (Index k = 0; k < n; ++k)
    for (Index j = 0; j < n; ++j) rows(k, j) = remainder(matrix(k, j), prime);
  Index value = 1;
  for (Index k = 0; k < n; ++k) {
    Index pivot = k;
    while (pivot < n && rows(pivot, k) == 0) ++pivot;
    if (pivot == n) return 0;
    if (pivot != k) {
      std::swap_ranges(rows[k].begin(), rows[k].end(), rows[pivot].begin());
      value = prime - value;
    }
    value = value * rows(k, k) % prime;
    Index inverse = inverse_modulo(rows(k, k), prime);
    for (Index i = k + 1; i < n; ++i) {
      if (rows(i, k) == 0) continue;
      Index factor = rows(i, k) * inverse % prime;
      for (Index j = k; j < n; ++j)
        rows(i, j) = remainder(rows(i, j) + (prime - factor) * rows(k, j), prime);
    }
  }
  return value;
}

}  // namespace

void bind_knots(nanobind::module_ &m) {
  namespace nb = nanobind;
  m.def("simplified", simplified, nb::arg("polygon"),
        "Return a closed polygon (n, 3) without all vertices that its knot does not need.");
  m.def("tightened", tightened, nb::arg("polygon"), nb::arg("pull"),
        "Return a closed polygon with each vertex moved towards the middle of its neighbours.");
  m.def("crossings", crossings, nb::arg("points"),
        "Return the crossings of a closed polygon (n, 3) in its projection along z.");
  m.def("determinant", determinant, nb::arg("matrix"), nb::arg("prime"),
        "Return the determinant of a square matrix of integers modulo a prime below 2^31.");
}

}  // namespace foldback
