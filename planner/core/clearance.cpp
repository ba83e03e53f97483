#include "clearance.hpp"

#include <algorithm>
#include <cmath>

#include "module_bindings.hpp"
#include "pairs.hpp"
#include "pairs_bindings.hpp"

namespace foldback {

namespace {

// Amount, pitches, added to upper bounds of a module's clearance that follow from distances of
// centres. With less than the rounding error of a distance, the closest pair of modules could be
// skipped.
constexpr double DISTANCE_MARGIN = 1e-9;

// True if a part is a box along the axes of its module's frame; its centre and half sides are
// written then.
bool is_box(Part &part, double size) {
  if (part.vertices.size() != 8 || part.normals.size() != 3 || part.edges.size() != 3) return false;
  bool is_corner[8] = {};
  double low[3], high[3];
  for (int r = 0; r < 3; ++r) {
    low[r] = high[r] = part.vertices(0, r);
    for (Index k = 0; k < 8; ++k) {
      low[r] = std::min(low[r], part.vertices(k, r));
      high[r] = std::max(high[r], part.vertices(k, r));
    }
  }
  for (Index k = 0; k < 8; ++k) {
    int corner = 0;
    for (int r = 0; r < 3; ++r) {
      const double x = part.vertices(k, r);
      if (x != low[r] && x != high[r]) return false;
      corner |= (x == high[r]) << r;
    }
    is_corner[corner] = true;
  }
  if (!std::all_of(is_corner, is_corner + 8, [](bool corner) { return corner; })) return false;
  for (int r = 0; r < 3; ++r) {
    part.half[r] = 0.5 * (high[r] - low[r]) * size;
    part.centre[r] = 0.5 * (high[r] + low[r]) * size;
  }
  return true;
}

// R^T v.
Vector<double> rotate_back(const Matrix<double> &rotation, const Vector<double> &v) {
  Vector<double> result;
  for (int c = 0; c < 3; ++c)
    result[c] = rotation(0, c) * v.x + rotation(1, c) * v.y + rotation(2, c) * v.z;
  return result;
}

// Least and largest projection of vertices on an axis.
struct Interval {
  double low, high;
  Interval(View<const double, 2> vertices, const Vector<double> &axis)
      : low(INFINITE), high(-INFINITE) {
    for (Index k = 0; k < vertices.size(); ++k) {
      double place = vertices(k, 0) * axis.x + vertices(k, 1) * axis.y + vertices(k, 2) * axis.z;
      low = std::min(low, place);
      high = std::max(high, place);
    }
  }
};

// Two boxes as the candidate axes see them: the way between the centres and the orientation of b,
// both in the frame of a.
struct RelativeBoxes {
  Vector<double> across;
  Matrix<double> relative;

  RelativeBoxes(const Vector<double> &gap, const Matrix<double> &a, const Matrix<double> &b)
      : across(rotate_back(a, gap)) {
    for (int r = 0; r < 3; ++r)
      for (int c = 0; c < 3; ++c)
        relative(r, c) = a(0, r) * b(0, c) + a(1, r) * b(1, c) + a(2, r) * b(2, c);
  }

  // Separation along face normal k of a, with the half sides of a and those of b.
  double face_of_a(int k, const double *of_a, const double *of_b) const {
    double reach = of_a[k] + std::abs(relative(k, 0)) * of_b[0] +
                   std::abs(relative(k, 1)) * of_b[1] + std::abs(relative(k, 2)) * of_b[2];
    return std::abs(across[k]) - reach;
  }

  // Separation along face normal c of b.
  double face_of_b(int c, const double *of_a, const double *of_b) const {
    double distance =
        across.x * relative(0, c) + across.y * relative(1, c) + across.z * relative(2, c);
    double reach = of_b[c] + std::abs(relative(0, c)) * of_a[0] +
                   std::abs(relative(1, c)) * of_a[1] + std::abs(relative(2, c)) * of_a[2];
    return std::abs(distance) - reach;
  }

  // Squared length of the cross product of edge r of a and edge c of b.
  double squared_sine(int r, int c) const {
    int r1 = (r + 1) % 3, r2 = (r + 2) % 3;
    return relative(r1, c) * relative(r1, c) + relative(r2, c) * relative(r2, c);
  }

  // Separation along that cross product; −∞ for parallel edges.
  double edges(int r, int c, const double *of_a, const double *of_b) const {
    int r1 = (r + 1) % 3, r2 = (r + 2) % 3, c1 = (c + 1) % 3, c2 = (c + 2) % 3;
    double square = squared_sine(r, c);
    if (square < MIN_CROSS * MIN_CROSS) return -INFINITE;
    double distance = across[r2] * relative(r1, c) - across[r1] * relative(r2, c);
    double reach = of_a[r1] * std::abs(relative(r2, c)) + of_a[r2] * std::abs(relative(r1, c)) +
                   of_b[c1] * std::abs(relative(r, c2)) + of_b[c2] * std::abs(relative(r, c1));
    return (std::abs(distance) - reach) * (1.0 / std::sqrt(square));
  }
};

// Candidate axis k of 15: face normals of a, face normals of b, and the cross products of edge r of
// a and edge c of b for k = 6 + 3 r + c.
Vector<double> box_axis(int k, const RelativeBoxes &boxes, const Matrix<double> &a,
                        const Matrix<double> &b) {
  Vector<double> axis;
  int r = (k - 6) / 3, c = (k - 6) % 3, r1 = (r + 1) % 3, r2 = (r + 2) % 3;
  for (int x = 0; x < 3; ++x) {
    if (k < 3)
      axis[x] = a(x, k);
    else if (k < 6)
      axis[x] = b(x, k - 3);
    else
      axis[x] = (boxes.relative(r1, c) * a(x, r2) - boxes.relative(r2, c) * a(x, r1)) /
                std::sqrt(boxes.squared_sine(r, c));
  }
  return axis;
}

}  // namespace

Solid::Solid(const Hull &hull, double size) : hull_(hull), size_(size) {
  for (Index q = 0; q < hull.parts.size(); ++q) {
    const Index *at = hull.parts[q].data();
    Part part{hull.vertices.slice(at[0], at[1]),
              hull.normals.slice(at[2], at[3]),
              hull.edges.slice(at[4], at[5]),
              false,
              {},
              {0.0, 0.0, 0.0},
              0.0};
    part.is_box = is_box(part, size);
    if (!part.is_box) {
      for (Index k = 0; k < part.vertices.size(); ++k)
        part.centre = part.centre + load(part.vertices[k].data());
      part.centre = scaled(part.centre, size / static_cast<double>(part.vertices.size()));
    }
    for (Index k = 0; k < part.vertices.size(); ++k) {
      const Vector<double> way = scaled(load(part.vertices[k].data()), size) - part.centre;
      part.radius = std::max(part.radius, std::sqrt(dot(way, way)));
    }
    parts_.push_back(part);
  }
  const Part &part = parts_[0];
  is_plain_ = hull.pieces.size() == 1 && parts_.size() == 1 &&
              !(part.is_box && dot(part.centre, part.centre) > 0.0);
}

Separation Solid::least_of_parts(Index i, Index j, const Vector<double> &gap,
                                 const Matrix<double> &a, const Matrix<double> &b,
                                 double enough) const {
  Separation least{INFINITE, {}};
  for (const Part &p : parts(i))
    for (const Part &q : parts(j)) {
      // Of two balls, what they are apart is a separation, too.
      const Vector<double> way = between_centres(p, q, gap, a, b);
      const double distance = std::sqrt(dot(way, way));
      const double wanted = std::min(enough, least.distance);
      Separation separation{distance - p.radius - q.radius, scaled(way, 1.0 / distance)};
      if (separation.distance < wanted || distance == 0.0)
        separation = of_parts(p, q, p.is_box && q.is_box ? way : gap, a, b, wanted);
      if (separation.distance < least.distance) least = separation;
    }
  return least;
}

Separation Solid::box_separation(const Part &p, const Part &q, const Vector<double> &gap,
                                 const Matrix<double> &a, const Matrix<double> &b,
                                 double enough) const {
  const RelativeBoxes boxes(gap, a, b);
  double best = -INFINITE;
  int best_axis = 0;
  for (int k = 0; k < 15 && best < enough; ++k) {
    double separation = k < 3   ? boxes.face_of_a(k, p.half, q.half)
                        : k < 6 ? boxes.face_of_b(k - 3, p.half, q.half)
                                : boxes.edges((k - 6) / 3, (k - 6) % 3, p.half, q.half);
    if (separation > best) {
      best = separation;
      best_axis = k;
    }
  }
  return {best, box_axis(best_axis, boxes, a, b)};
}

Separation Solid::hull_separation(const Part &p, const Part &q, const Vector<double> &gap,
                                  const Matrix<double> &a, const Matrix<double> &b,
                                  double enough) const {
  Separation best{-INFINITE, {}};
  auto try_axis = [&](const Vector<double> &axis) {
    double distance = axis.x * gap.x + axis.y * gap.y + axis.z * gap.z;
    Interval of_a(p.vertices, rotate_back(a, axis)), of_b(q.vertices, rotate_back(b, axis));
    double separation = std::max(distance + size_ * (of_b.low - of_a.high),
                                 -distance + size_ * (of_a.low - of_b.high));
    if (separation > best.distance) best = {separation, axis};
    return best.distance >= enough;
  };
  for (Index k = 0; k < p.normals.size(); ++k)
    if (try_axis(rotate(a, p.normals[k].data()))) return best;
  for (Index k = 0; k < q.normals.size(); ++k)
    if (try_axis(rotate(b, q.normals[k].data()))) return best;
  for (Index k = 0; k < p.edges.size(); ++k)
    for (Index l = 0; l < q.edges.size(); ++l) {
      Vector<double> axis = cross(rotate(a, p.edges[k].data()), rotate(b, q.edges[l].data()));
      double length = std::sqrt(dot(axis, axis));
      if (length < MIN_CROSS) continue;
      if (try_axis({axis.x / length, axis.y / length, axis.z / length})) return best;
    }
  return best;
}

namespace {

struct Closest {
  double separation;
  Index first, second;
};

// Least separation over pairs of one configuration, and the pair that has it. If all pairs are at
// least `enough` apart, that is `enough` with the pair (−1, −1).
Closest least_separation(View<const double, 2> positions, View<const double, 3> rotations,
                         View<const Index, 2> pairs, const Solid &solid, double enough) {
  Closest best{enough, -1, -1};
  for (Index k = 0; k < pairs.size(); ++k) {
    Index i = pairs(k, 0), j = pairs(k, 1);
    Vector<double> gap = load(positions[j].data()) - load(positions[i].data());
    if (std::sqrt(dot(gap, gap)) - 2.0 * solid.radius() >= best.separation) continue;
    double separation = solid
                            .separation(i, j, gap, load_matrix(rotations[i].data()),
                                        load_matrix(rotations[j].data()), best.separation)
                            .distance;
    if (separation < best.separation) best = {separation, i, j};
  }
  return best;
}

// The named tuple `Solid` of Python.
struct SolidFields {
  Hull hull;
  double size, inner_radius;
};
auto fields(SolidFields &s) { return std::tie(s.hull, s.size, s.inner_radius); }

// Least separation of every module in one configuration, and the other module. A separation lies
// between the centres' distance less two radii and less two inner radii, so the nearest centre of a
// module bounds its result, and most pairs need no separating axes. Of modules of several parts, no
// part need hold the centre, so that there is no such upper bound.
class ModuleClearances {
 public:
  ModuleClearances(const SolidFields &fields, Index modules, Index min_checked_gap, double cutoff)
      : solid_(fields.hull, fields.size),
        inner_(fields.hull.parts.size() == fields.hull.pieces.size()
                   ? 2.0 * fields.inner_radius * fields.size
                   : -INFINITE),
        min_checked_gap_(min_checked_gap),
        cutoff_(cutoff),
        best_(modules),
        bound_(modules) {}

  void write(View<const double, 2> points, View<const double, 3> rotations,
             View<float, 1> clearance, View<std::int32_t, 1> nearest) {
    const double outer = 2.0 * solid_.radius();
    find_near_pairs(points, outer + cutoff_, min_checked_gap_, pairs_);
    std::fill(best_.begin(), best_.end(), cutoff_);
    std::fill(bound_.begin(), bound_.end(), cutoff_);
    std::fill(nearest.begin(), nearest.end(), -1);
    distances_.resize(pairs_.size());
    for (std::size_t k = 0; k < pairs_.size(); ++k) {
      auto [i, j] = pairs_[k];
      Vector<double> gap = load(points[j].data()) - load(points[i].data());
      distances_[k] = std::sqrt(dot(gap, gap));
      double most = distances_[k] - inner_ + DISTANCE_MARGIN;
      bound_[i] = std::min(bound_[i], most);
      bound_[j] = std::min(bound_[j], most);
    }
    for (std::size_t k = 0; k < pairs_.size(); ++k) {
      auto [i, j] = pairs_[k];
      double enough = std::max(std::min(best_[i], bound_[i]), std::min(best_[j], bound_[j]));
      if (distances_[k] - outer >= enough) continue;
      Vector<double> gap = load(points[j].data()) - load(points[i].data());
      double separation = solid_
                              .separation(i, j, gap, load_matrix(rotations[i].data()),
                                          load_matrix(rotations[j].data()), enough)
                              .distance;
      for (auto [module, other] : {Pair{i, j}, Pair{j, i}})
        if (separation < best_[module]) {
          best_[module] = separation;
          nearest[module] = static_cast<std::int32_t>(other);
        }
    }
    for (std::size_t i = 0; i < best_.size(); ++i) clearance[i] = static_cast<float>(best_[i]);
  }

 private:
  Solid solid_;
  double inner_;
  Index min_checked_gap_;
  double cutoff_;
  std::vector<Pair> pairs_;
  std::vector<double> best_, bound_, distances_;
};

}  // namespace

void bind_clearance(nanobind::module_ &m) {
  namespace nb = nanobind;
  m.def(
      "pair_separation",
      [](View<const double, 1> gap, View<const double, 2> a, View<const double, 2> b, Hull hull,
         double size, double enough, Index first, Index second) {
        require(gap.size() == 3, "gap: (3,)");
        require(a.shape() == std::array<Index, 2>{3, 3} && b.shape() == a.shape(),
                "rotation_a, rotation_b: (3, 3)");
        require(first >= 0 && second >= 0, "first, second: not negative");
        require_hull(hull);
        return Solid(hull, size)
            .separation(first, second, load(gap.data()), load_matrix(a.data()),
                        load_matrix(b.data()), enough)
            .distance;
      },
      nb::arg("gap"), nb::arg("rotation_a"), nb::arg("rotation_b"), nb::arg("hull"),
      nb::arg("size"), nb::arg("enough"), nb::arg("first") = 0, nb::arg("second") = 0,
      "Return the separation of two modules of a chain.");
  m.def(
      "least_separation",
      [](View<const double, 2> positions, View<const double, 3> rotations,
         View<const Index, 2> pairs, Hull hull, double size, double enough) {
        Index n = positions.size();
        require(positions.axis(1) == 3, "positions: (n, 3)");
        require(rotations.shape() == std::array<Index, 3>{n, 3, 3}, "rotations: (n, 3, 3)");
        require_pairs(pairs, n);
        require_hull(hull);
        Closest closest = least_separation(positions, rotations, pairs, Solid(hull, size), enough);
        return nb::make_tuple(closest.separation, closest.first, closest.second);
      },
      nb::arg("positions"), nb::arg("rotations"), nb::arg("pairs"), nb::arg("hull"),
      nb::arg("size"), nb::arg("enough"),
      "Return the least separation over pairs of one configuration, and the pair that has it.");
  m.def(
      "module_clearances",
      [](View<const double, 3> positions, View<const double, 4> rotations, SolidFields solid,
         Index min_checked_gap, double cutoff, View<float, 2> clearance,
         View<std::int32_t, 2> nearest) {
        Index frames = positions.size(), n = positions.axis(1);
        require(positions.axis(2) == 3, "positions: (F, n, 3)");
        require(rotations.shape() == std::array<Index, 4>{frames, n, 3, 3},
                "rotations: (F, n, 3, 3)");
        require(clearance.shape() == std::array<Index, 2>{frames, n}, "clearance: (F, n)");
        require(nearest.shape() == clearance.shape(), "nearest: (F, n)");
        require(min_checked_gap > 0, "min_checked_gap: positive");
        require_hull(solid.hull);
        nb::gil_scoped_release release;
        ModuleClearances clearances(solid, n, min_checked_gap, cutoff);
        for (Index f = 0; f < frames; ++f)
          clearances.write(positions[f], rotations[f], clearance[f], nearest[f]);
      },
      nb::arg("positions"), nb::arg("rotations"), nb::arg("solid"), nb::arg("min_checked_gap"),
      nb::arg("cutoff"), nb::arg("clearance"), nb::arg("nearest"),
      "Write the least separation of every module in every configuration, and the other module.");
}

}  // namespace foldback
