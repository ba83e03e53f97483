// Contact points of modules with the floor and each other, and hinge torques of forces.
//
// Two convex parts touch along the axis that separates them best, as in `clearance.hpp`. If that
// is a face's normal, the points are the corners of the intersection of the two faces; if it is
// across two edges, there is one point between them.
//
// The torque of a hinge is the moment of all forces beyond it. The two forces of a contact between
// modules cancel for all hinges but those between the two, so that its column is sparse.
#include <nanobind/stl/tuple.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <span>
#include <vector>

#include "module_bindings.hpp"
#include "pairs.hpp"
#include "vectors.hpp"

namespace foldback {

namespace {

// Distance in pitches by which an axis across two edges must separate two modules better than the
// best face normal for them to touch edge to edge.
constexpr double EDGE_BIAS = 0.01;
// Distance in pitches by which a face of the second module must separate two modules better than
// one of the first for it to be the reference face of their contact. Without it rounding could swap
// both between frames.
constexpr double FACE_BIAS = 1e-6;
// Minimum width in pitches of the area that two opposite faces share for them to count as touching;
// it is also the fraction of their length by which two edges may cross beyond their ends.
constexpr double MIN_OVERLAP_WIDTH = 0.02;
// Distance in pitches below which two contact points of a pair of modules are merged into one.
constexpr double MIN_POINT_DISTANCE = 1e-4;
// Distance in pitches up to which a polygon's corner counts as lying on the plane that clips the
// polygon, and is kept. With smaller values rounding adds nearly equal corners.
constexpr double PLANE_TOLERANCE = 1e-9;
// Sine of the angle between two edges below which they count as parallel, and their cross product
// is no candidate for the contact normal.
constexpr double MIN_EDGE_ANGLE = 1e-3;
// Determinant |u|² |v|² − (u·v)² of two edge vectors u and v, in pitches⁴, below which they count
// as parallel and have no single closest point: it avoids a division by zero.
constexpr double MIN_EDGE_DETERMINANT = 1e-12;
// Magnitude of the torque of a unit force at a hinge, in pitches, below which it counts as zero and
// is left out of the sparse matrix of the force balance.
constexpr double MIN_TORQUE = 1e-12;
// Maximum number of corners of the area that two touching faces share, each of which is a contact
// point; further ones are dropped.
constexpr int MAX_CORNERS = 16;
// Module number that stands for the floor.
constexpr Index FLOOR = -1;

using Vectors = std::span<const Vector<double>>;

// Parts of the modules of a chain with their faces and edges: the named tuple `FacetedHull` of
// Python.
struct FacetedHull {
  View<const double, 2> vertices, normals;
  View<const Index, 2> loops, edges;
  View<const double, 2> directions;
  View<const Index, 2> parts, pieces;
  View<const Index, 1> kinds;
  double radius;
  Index piece(Index module) const { return kinds[module % kinds.size()]; }

  // Corners of a face, counterclockwise from outside.
  std::span<const Index> loop(Index face) const {
    View<const Index, 1> row = loops[face];
    return {row.begin(), std::find(row.begin(), row.end(), -1)};
  }
};

// Hinges in the world frame: the named tuple `Hinges` of Python.
struct Hinges {
  View<const double, 2> axes, anchors;
  View<const Index, 1> before;
};

auto fields(FacetedHull &h) {
  return std::tie(h.vertices, h.normals, h.loops, h.edges, h.directions, h.parts, h.pieces, h.kinds,
                  h.radius);
}
auto fields(Hinges &h) { return std::tie(h.axes, h.anchors, h.before); }

struct ContactPoint {
  Index first, second;  // modules that are pushed along the normal, and against it
  Index feature;        // mostly the same number in the next frame
  Vector<double> point, normal;
  double gap;
};

// Convex polygon with few corners.
struct ContactArea {
  std::array<Vector<double>, MAX_CORNERS> corners;
  int count = 0;
  void add(const Vector<double> &corner) {
    if (count < MAX_CORNERS) corners[count++] = corner;
  }
};

struct FaceGap {
  double gap;
  Index face;
};

// Part of a module in the world frame. Its edges count its own corners.
struct PlacedPart {
  Vectors corners, normals, directions;
  View<const Index, 2> edges;
  Index first_face;  // number of its first face
};

// R v with one rounding for each term. A product of matrices by BLAS rounds so where the processor
// has FMA; of several faces that separate two modules equally well, rounding decides which one is
// taken, and so the plan.
Vector<double> rotate_fused(const Matrix<double> &r, const double *v) {
  Vector<double> rotated;
  for (int k = 0; k < 3; ++k)
    rotated[k] = std::fma(r(k, 2), v[2], std::fma(r(k, 1), v[1], r(k, 0) * v[0]));
  return rotated;
}

// Parts of modules in the world frame.
class PlacedParts {
 public:
  PlacedParts(View<const double, 2> positions, View<const double, 3> rotations,
              const FacetedHull &solid)
      : solid_(solid) {
    for (Index i = 0; i < positions.size(); ++i) {
      const Matrix<double> rotation = load_matrix(rotations[i].data());
      const Vector<double> centre = load(positions[i].data());
      const Index first = solid.pieces(solid.piece(i), 0), last = end(i) - 1;
      bases_.push_back({size_of(corners_) - solid.parts(first, 0),
                        size_of(normals_) - solid.parts(first, 2),
                        size_of(directions_) - solid.parts(first, 6)});
      for (Index v = solid.parts(first, 0); v < solid.parts(last, 1); ++v)
        corners_.push_back(rotate_fused(rotation, solid.vertices[v].data()) + centre);
      for (Index f = solid.parts(first, 2); f < solid.parts(last, 3); ++f)
        normals_.push_back(rotate_fused(rotation, solid.normals[f].data()));
      for (Index d = solid.parts(first, 6); d < solid.parts(last, 7); ++d)
        directions_.push_back(rotate_fused(rotation, solid.directions[d].data()));
    }
  }

  // Parts of module i: from `begin` up to `end`.
  Index begin(Index i) const { return solid_.pieces(solid_.piece(i), 0); }
  Index end(Index i) const { return solid_.pieces(solid_.piece(i), 1); }

  PlacedPart part(Index i, Index q) const {
    const Index *at = solid_.parts[q].data();
    const auto [corners, normals, directions] = bases_[i];
    return {of(corners_, corners, at), of(normals_, normals, at + 2),
            of(directions_, directions, at + 6), solid_.edges.slice(at[4], at[5]), at[2]};
  }

 private:
  static Index size_of(const std::vector<Vector<double>> &all) {
    return static_cast<Index>(all.size());
  }
  static Vectors of(const std::vector<Vector<double>> &all, Index base, const Index *range) {
    return {all.data() + base + range[0], static_cast<std::size_t>(range[1] - range[0])};
  }
  const FacetedHull &solid_;
  std::vector<Vector<double>> corners_, normals_, directions_;
  std::vector<std::array<Index, 3>> bases_;  // what leads from a number of the hull to one here
};

// Face that separates a part best from another one, and by how much.
FaceGap best_face(const PlacedPart &part, const FacetedHull &solid, const PlacedPart &other) {
  FaceGap best{-INFINITE, 0};
  for (std::size_t f = 0; f < part.normals.size(); ++f) {
    const Vector<double> &normal = part.normals[f];
    double least = INFINITE;
    for (const Vector<double> &corner : other.corners) least = std::min(least, dot(normal, corner));
    Index face = part.first_face + static_cast<Index>(f);
    double gap = least - dot(normal, part.corners[solid.loops(face, 0)]);
    if (gap > best.gap) best = {gap, face};
  }
  return best;
}

// Best separation across two edges; write its axis, from a to b. The vector `between` leads from
// the centre of one module to that of the other one.
double best_edges(const PlacedPart &a, const PlacedPart &b, const Vector<double> &between,
                  Vector<double> &axis) {
  double best = -INFINITE;
  for (const Vector<double> &along_a : a.directions)
    for (const Vector<double> &along_b : b.directions) {
      Vector<double> across = cross(along_a, along_b);
      double length = std::sqrt(dot(across, across));
      if (length < MIN_EDGE_ANGLE) continue;
      if (dot(across, between) < 0.0) length = -length;
      for (int r = 0; r < 3; ++r) across[r] /= length;
      double high = -INFINITE, low = INFINITE;
      for (const Vector<double> &corner : a.corners) high = std::max(high, dot(across, corner));
      for (const Vector<double> &corner : b.corners) low = std::min(low, dot(across, corner));
      if (low - high > best) {
        best = low - high;
        axis = across;
      }
    }
  return best;
}

struct Edge {
  Vector<double> start, end;
};

// Edge that extends farthest along plus or minus an axis.
Edge supporting_edge(Vectors corners, View<const Index, 2> edges, const Vector<double> &axis,
                     double sign) {
  double best = -INFINITE;
  Index which = 0;
  for (Index e = 0; e < edges.size(); ++e) {
    double along = sign * dot(corners[edges(e, 0)] + corners[edges(e, 1)], axis);
    if (along > best) {
      best = along;
      which = e;
    }
  }
  return {corners[edges(which, 0)], corners[edges(which, 1)]};
}

// Write the point halfway between two edges; true if it lies on both.
bool between_edges(const Edge &a, const Edge &b, Vector<double> &point) {
  Vector<double> u = a.end - a.start, v = b.end - b.start, w = a.start - b.start;
  double uu = dot(u, u), uv = dot(u, v), vv = dot(v, v), uw = dot(u, w), vw = dot(v, w);
  double scale = uu * vv - uv * uv;
  if (scale < MIN_EDGE_DETERMINANT) return false;
  double s = (uv * vw - vv * uw) / scale, t = (uu * vw - uv * uw) / scale;
  if (std::min(s, t) < -MIN_OVERLAP_WIDTH || std::max(s, t) > 1.0 + MIN_OVERLAP_WIDTH) return false;
  point = scaled(a.start + scaled(u, s) + b.start + scaled(v, t), 0.5);
  return true;
}

// Part of a polygon in front of a plane through a point, with a normal that leads inwards.
ContactArea clipped(const ContactArea &polygon, const Vector<double> &point,
                    const Vector<double> &inward) {
  ContactArea part;
  double level = dot(point, inward);
  for (int k = 0; k < polygon.count; ++k) {
    const Vector<double> &p = polygon.corners[k], &q = polygon.corners[(k + 1) % polygon.count];
    double dp = dot(p, inward) - level, dq = dot(q, inward) - level;
    if (dp >= -PLANE_TOLERANCE) part.add(p);
    if ((dp > PLANE_TOLERANCE && dq < -PLANE_TOLERANCE) ||
        (dp < -PLANE_TOLERANCE && dq > PLANE_TOLERANCE))
      part.add(p + scaled(q - p, dp / (dp - dq)));
  }
  return part;
}

// A face of a part in the world frame.
struct Face {
  Vectors corners;              // of its part
  std::span<const Index> loop;  // its own
  Vector<double> normal;
  const Vector<double> &corner(std::size_t k) const { return corners[loop[k % loop.size()]]; }

  // Unit vector in its plane, across a side, towards its inside.
  Vector<double> inward(std::size_t side) const {
    Vector<double> inward = cross(normal, corner(side + 1) - corner(side));
    double length = std::sqrt(dot(inward, inward));
    return {inward.x / length, inward.y / length, inward.z / length};
  }
};

// Corners of the intersection of two faces, seen along the first one's normal.
class CommonCorners {
 public:
  // Corners farther from the first face than `max_gap`, in pitches, are left out; so is an
  // intersection that is narrower than MIN_OVERLAP_WIDTH.
  CommonCorners(const Face &face, const Face &other, double max_gap) {
    ContactArea polygon;
    for (Index corner : other.loop) polygon.add(other.corners[corner]);
    for (std::size_t k = 0; k < face.loop.size() && polygon.count > 0; ++k)
      polygon = clipped(polygon, face.corner(k), face.inward(k));
    double level = dot(face.corner(0), face.normal);
    for (int k = 0; k < polygon.count; ++k) {
      const Vector<double> &corner = polygon.corners[k];
      double gap = dot(corner, face.normal) - level;
      if (!(gap <= max_gap) || !is_new(corner, face.normal)) continue;
      points_.add(corner - scaled(face.normal, 0.5 * gap));
      gaps_[points_.count - 1] = gap;
    }
    if (!is_wide(face)) points_.count = 0;
  }

  int count() const { return points_.count; }
  // Point halfway between both faces, and their distance.
  const Vector<double> &point(int k) const { return points_.corners[k]; }
  double gap(int k) const { return gaps_[k]; }

 private:
  // True if a corner is none of those that the points were made of.
  bool is_new(const Vector<double> &corner, const Vector<double> &normal) const {
    for (int m = 0; m < points_.count; ++m) {
      double distance = 0.0;
      for (int r = 0; r < 3; ++r) {
        double before = points_.corners[m][r] + 0.5 * gaps_[m] * normal[r];
        distance = std::max(distance, std::abs(before - corner[r]));
      }
      if (distance < MIN_POINT_DISTANCE) return false;
    }
    return true;
  }

  bool is_wide(const Face &face) const {
    for (std::size_t k = 0; k < face.loop.size(); ++k) {
      Vector<double> inward = face.inward(k);
      double width = -INFINITE, level = dot(face.corner(k), inward);
      for (int m = 0; m < points_.count; ++m)
        width = std::max(width, dot(points_.corners[m], inward) - level);
      if (width < MIN_OVERLAP_WIDTH) return false;
    }
    return true;
  }

  ContactArea points_;
  std::array<double, MAX_CORNERS> gaps_;
};

// Contact points of a configuration.
class ContactSearch {
 public:
  ContactSearch(View<const double, 2> positions, View<const double, 3> rotations,
                const FacetedHull &solid)
      : positions_(positions), solid_(solid), placed_(positions, rotations, solid) {}

  // Add the points of corners that are at most `floor_gap` above the floor, in pitches.
  void add_floor(double floor_gap) {
    for (Index i = 0; i < positions_.size(); ++i) {
      if (!(positions_(i, 2) <= solid_.radius + floor_gap)) continue;
      Index corner = 0;
      for (Index q = placed_.begin(i); q < placed_.end(i); ++q)
        for (const Vector<double> &point : placed_.part(i, q).corners) {
          if (point.z <= floor_gap)
            points_.push_back({i, FLOOR, corner, point, {0.0, 0.0, 1.0}, point.z});
          ++corner;
        }
    }
  }

  // Add the points between two modules that are at most `module_gap` apart, in pitches.
  void add_pair(Index i, Index j, double module_gap) {
    Index first_feature = 0;
    for (Index p = placed_.begin(i); p < placed_.end(i); ++p)
      for (Index q = placed_.begin(j); q < placed_.end(j); ++q) {
        add_parts({i, placed_.part(i, p)}, {j, placed_.part(j, q)}, first_feature, module_gap);
        first_feature += solid_.normals.size() * MAX_CORNERS + 1;
      }
  }

  const std::vector<ContactPoint> &points() const { return points_; }

 private:
  struct PartOf {
    Index module;
    PlacedPart part;
  };

  // Add the points between a part of one module and a part of another one.
  void add_parts(const PartOf &one, const PartOf &other, Index first_feature, double module_gap) {
    const auto &[i, a] = one;
    const auto &[j, b] = other;
    FaceGap of_a = best_face(a, solid_, b);
    if (of_a.gap > module_gap) return;
    FaceGap of_b = best_face(b, solid_, a);
    if (of_b.gap > module_gap) return;
    Vector<double> between = load(positions_[j].data()) - load(positions_[i].data()), axis{};
    double gap = best_edges(a, b, between, axis);
    if (gap > module_gap) return;
    if (gap <= std::max(of_a.gap, of_b.gap) + EDGE_BIAS) {
      if (of_b.gap > of_a.gap + FACE_BIAS)
        add_face(other, one, of_b.face, first_feature, module_gap);
      else
        add_face(one, other, of_a.face, first_feature, module_gap);
      return;
    }
    Vector<double> point;
    if (between_edges(supporting_edge(a.corners, a.edges, axis, 1.0),
                      supporting_edge(b.corners, b.edges, axis, -1.0), point))
      points_.push_back({j, i, first_feature - 1, point, axis, gap});
  }

  // Add the points of a face of one part with another part.
  void add_face(const PartOf &one, const PartOf &other, Index face, Index first_feature,
                double module_gap) {
    const PlacedPart &a = one.part, &b = other.part;
    const Vector<double> &normal = a.normals[face - a.first_face];
    double least = INFINITE;
    Index opposite = 0;
    for (std::size_t f = 0; f < b.normals.size(); ++f)
      if (double cosine = dot(b.normals[f], normal); cosine < least) {
        least = cosine;
        opposite = static_cast<Index>(f);
      }
    const CommonCorners corners(
        {a.corners, solid_.loop(face), normal},
        {b.corners, solid_.loop(b.first_face + opposite), b.normals[opposite]}, module_gap);
    for (int m = 0; m < corners.count(); ++m)
      points_.push_back({other.module, one.module, first_feature + face * MAX_CORNERS + m,
                         corners.point(m), normal, corners.gap(m)});
  }

  View<const double, 2> positions_;
  const FacetedHull &solid_;
  PlacedParts placed_;
  std::vector<ContactPoint> points_;
};

void require_faceted_hull(const FacetedHull &hull) {
  Index corners = hull.vertices.size(), faces = hull.normals.size();
  require(corners > 0 && hull.vertices.axis(1) == 3, "solid.vertices: (V, 3)");
  require(faces > 0 && hull.normals.axis(1) == 3, "solid.normals: (F, 3)");
  require(hull.loops.size() == faces && hull.loops.axis(1) > 0 && hull.loops.axis(1) <= MAX_CORNERS,
          "solid.loops: (F, M), at most 16 corners each");
  require(hull.edges.size() > 0 && hull.edges.axis(1) == 2, "solid.edges: (E, 2)");
  require(hull.directions.axis(1) == 3, "solid.directions: (D, 3)");
  require(hull.parts.axis(1) == 8, "solid.parts: (Q, 8)");
  const Index ends[4] = {corners, faces, hull.edges.size(), hull.directions.size()};
  for (Index q = 0; q < hull.parts.size(); ++q) {
    const Index *at = hull.parts[q].data();
    for (int k = 0; k < 4; ++k)
      require_range(at[2 * k], at[2 * k + 1], ends[k],
                    "solid.parts: vertices, faces, edges and directions from … up to …");
    for (Index corner : hull.loops.slice(at[2], at[3]))
      require(corner >= -1 && corner < at[1] - at[0], "solid.loops: -1, or a vertex of the part");
    for (Index corner : hull.edges.slice(at[4], at[5]))
      require(corner >= 0 && corner < at[1] - at[0], "solid.edges: vertices of the part");
  }
  for (Index f = 0; f < faces; ++f) require(hull.loops(f, 0) >= 0, "solid.loops: a corner each");
  require_pattern(hull.pieces, hull.kinds, 0, hull.parts.size());
  for (Index p = 0; p < hull.pieces.size(); ++p)
    for (Index q = hull.pieces(p, 0) + 1; q < hull.pieces(p, 1); ++q)
      for (int k = 0; k < 8; k += 2)
        require(hull.parts(q, k) == hull.parts(q - 1, k + 1), "solid.parts: one after the other");
}

// The fields of Python's `ContactPoints`.
auto contact_arrays(const std::vector<ContactPoint> &contacts) {
  Index count = static_cast<Index>(contacts.size());
  std::vector<Index> first, second, feature;
  std::vector<double> points(3 * count), normals(3 * count), gaps;
  for (Index k = 0; k < count; ++k) {
    const ContactPoint &contact = contacts[k];
    first.push_back(contact.first);
    second.push_back(contact.second);
    feature.push_back(contact.feature);
    store(contact.point, points.data() + 3 * k);
    store(contact.normal, normals.data() + 3 * k);
    gaps.push_back(contact.gap);
  }
  return named_tuple(
      "ContactPoints", owned_array(std::move(first), {count}),
      owned_array(std::move(second), {count}), owned_array(std::move(feature), {count}),
      owned_array(std::move(points), {count, 3}), owned_array(std::move(normals), {count, 3}),
      owned_array(std::move(gaps), {count}));
}

auto contact_points(View<const double, 2> positions, View<const double, 3> rotations,
                    FacetedHull solid, Index apart, double floor_gap, double module_gap) {
  Index n = positions.size();
  require(positions.axis(1) == 3, "positions: (n, 3)");
  require(rotations.shape() == std::array<Index, 3>{n, 3, 3}, "rotations: (n, 3, 3)");
  require(apart >= 0 && apart < (Index{1} << 31), "apart: 0 to 2^31 - 1");
  require_faceted_hull(solid);
  const double cutoff = 2.0 * solid.radius + module_gap;
  require(cutoff >= 0.0 && cutoff < MAX_CUTOFF, "solid.radius, module_gap: finite");
  std::vector<ContactPoint> contacts;
  {
    nanobind::gil_scoped_release release;
    std::vector<Pair> pairs;
    find_near_pairs(positions, cutoff, apart, pairs);
    ContactSearch search(positions, rotations, solid);
    search.add_floor(floor_gap);
    for (auto [i, j] : pairs) search.add_pair(i, j, module_gap);
    contacts = search.points();
  }
  return contact_arrays(contacts);
}

// Sparse columns of a matrix.
struct Columns {
  std::vector<std::int32_t> starts, rows;
  std::vector<double> values;
  void add(Index row, double value) {
    if (!(std::abs(value) > MIN_TORQUE)) return;
    rows.push_back(static_cast<std::int32_t>(row));
    values.push_back(value);
  }
};

// Add the hinge torques of a force at a point, and what it adds to those of the whole chain.
struct ForceBalance {
  const Hinges &hinges;
  Index root;
  bool is_held;

  void add_column(Index first, Index second, const Vector<double> &point,
                  const Vector<double> &force, Columns &out) const {
    // Only hinges between `low` and `high` transmit it, with a sign that depends on the side.
    const Index other = second >= 0 ? second : root;
    const Index low = std::min(first, other), high = std::max(first, other);
    const double sign = first == high ? -1.0 : 1.0;
    if (low != high) {
      const Index *begin = hinges.before.begin(), *end = hinges.before.end();
      Index stop = std::lower_bound(begin, end, high) - begin;
      for (Index h = std::lower_bound(begin, end, low) - begin; h < stop; ++h) {
        Vector<double> arm = point - load(hinges.anchors[h].data());
        out.add(h, sign * dot(load(hinges.axes[h].data()), cross(arm, force)));
      }
    }
    if (second >= 0 || is_held) return;
    Vector<double> moment = cross(point, force);
    for (int r = 0; r < 3; ++r) out.add(hinges.before.size() + r, force[r]);
    for (int r = 0; r < 3; ++r) out.add(hinges.before.size() + 3 + r, moment[r]);
  }
};

auto torque_columns(Hinges hinges, Index root, bool held, View<const Index, 1> first,
                    View<const Index, 1> second, View<const double, 2> points,
                    View<const double, 2> forces) {
  Index count = first.size(), J = hinges.before.size();
  require(hinges.axes.shape() == std::array<Index, 2>{J, 3}, "hinges.axes: (J, 3)");
  require(hinges.anchors.shape() == std::array<Index, 2>{J, 3}, "hinges.anchors: (J, 3)");
  require(second.size() == count, "first, second: (C,)");
  require(points.shape() == std::array<Index, 2>{count, 3}, "points: (C, 3)");
  require(forces.shape() == points.shape(), "forces: (C, 3)");
  Columns columns;
  {
    nanobind::gil_scoped_release release;
    const ForceBalance balance{hinges, root, held};
    for (Index c = 0; c < count; ++c) {
      columns.starts.push_back(static_cast<std::int32_t>(columns.values.size()));
      balance.add_column(first[c], second[c], load(points[c].data()), load(forces[c].data()),
                         columns);
    }
    columns.starts.push_back(static_cast<std::int32_t>(columns.values.size()));
  }
  Index size = static_cast<Index>(columns.values.size());
  return std::tuple(owned_array(std::move(columns.starts), {count + 1}),
                    owned_array(std::move(columns.rows), {size}),
                    owned_array(std::move(columns.values), {size}));
}

}  // namespace

void bind_statics(nanobind::module_ &m) {
  namespace nb = nanobind;
  m.def("contact_points", contact_points, nb::arg("positions"), nb::arg("rotations"),
        nb::arg("solid"), nb::arg("apart"), nb::arg("floor_gap"), nb::arg("module_gap"),
        "Return all contact points of one configuration that stands on the plane z = 0.");
  m.def("torque_columns", torque_columns, nb::arg("hinges"), nb::arg("root"), nb::arg("is_clamped"),
        nb::arg("first"), nb::arg("second"), nb::arg("points"), nb::arg("forces"),
        "Return the hinge torques that balance each of C forces, as sparse columns.");
}

}  // namespace foldback
