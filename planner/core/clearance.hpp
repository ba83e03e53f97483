// Clearance between modules, whose parts are convex, by separating axes.
//
// For two convex polyhedra the best separating axis is a face normal of one or a cross product of
// two edges. The largest separation over those axes is exactly minus the penetration depth when
// they overlap, and a lower bound of their distance, never zero or less, when they don't
// (Gottschalk, Lin, Manocha: OBBTree, 1996). So its sign decides collision exactly. Of modules of
// several convex parts, the least one of two parts does.
#pragma once

#include <span>
#include <vector>

#include "module.hpp"
#include "vectors.hpp"

namespace foldback {

// Minimum length of the cross product of two unit edges, the sine of their angle, for it to be
// tested as a separating axis of two convex modules. Shorter ones belong to parallel edges, which
// the face normals cover.
constexpr double MIN_CROSS = 1e-9;

struct Separation {
  double distance;
  Vector<double> axis;  // the unit axis that shows it, from a to b or back
};

// A convex part of a module at a given size, in the module's frame. Lengths in pitches.
struct Part {
  View<const double, 2> vertices, normals, edges;  // at full size
  bool is_box;                                     // along the axes of the module's frame
  double half[3];                                  // of a box along them
  Vector<double> centre;                           // of the box, or of a ball around the part
  double radius;                                   // of that ball
};

// Modules of a given size, by separating axes. A module is one or more convex parts.
class Solid {
 public:
  Solid(const Hull &hull, double size);

  // Separation of the modules i and j, the least one of their parts: from the centre of i to that
  // of j leads `gap`, in pitches. The search stops when it is known to be at least `enough`.
  Separation separation(Index i, Index j, const Vector<double> &gap, const Matrix<double> &a,
                        const Matrix<double> &b, double enough) const {
    return is_plain_ ? of_parts(parts_[0], parts_[0], gap, a, b, enough)
                     : least_of_parts(i, j, gap, a, b, enough);
  }

  // True if all modules are the same convex part, and a box is one about the centre.
  bool is_plain() const { return is_plain_; }

  std::span<const Part> parts(Index module) const {
    const Index piece = hull_.piece(module), begin = hull_.pieces(piece, 0);
    return {parts_.data() + begin, static_cast<std::size_t>(hull_.pieces(piece, 1) - begin)};
  }

  // Separation of a part of one module and a part of another one; with `gap` from the centre of the
  // one module to that of the other one.
  Separation part_separation(const Part &p, const Part &q, const Vector<double> &gap,
                             const Matrix<double> &a, const Matrix<double> &b,
                             double enough) const {
    if (is_plain_ || !(p.is_box && q.is_box)) return of_parts(p, q, gap, a, b, enough);
    return of_parts(p, q, between_centres(p, q, gap, a, b), a, b, enough);
  }

  // Way from the centre of a part to that of a part of another module.
  static Vector<double> between_centres(const Part &p, const Part &q, const Vector<double> &gap,
                                        const Matrix<double> &a, const Matrix<double> &b) {
    return gap + rotate(b, &q.centre.x) - rotate(a, &p.centre.x);
  }

  // Radius of the ball about the centre that every module lies in, in pitches.
  double radius() const { return hull_.radius * size_; }

 private:
  // Of two boxes, `gap` is the way between their own centres.
  Separation of_parts(const Part &p, const Part &q, const Vector<double> &gap,
                      const Matrix<double> &a, const Matrix<double> &b, double enough) const {
    return p.is_box && q.is_box ? box_separation(p, q, gap, a, b, enough)
                                : hull_separation(p, q, gap, a, b, enough);
  }
  Separation least_of_parts(Index i, Index j, const Vector<double> &gap, const Matrix<double> &a,
                            const Matrix<double> &b, double enough) const;
  Separation box_separation(const Part &p, const Part &q, const Vector<double> &gap,
                            const Matrix<double> &a, const Matrix<double> &b, double enough) const;
  Separation hull_separation(const Part &p, const Part &q, const Vector<double> &gap,
                             const Matrix<double> &a, const Matrix<double> &b, double enough) const;

  Hull hull_;
  double size_;
  std::vector<Part> parts_;
  bool is_plain_;
};

}  // namespace foldback
