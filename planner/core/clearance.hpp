// Clearance between convex modules by separating axes.
//
// For two convex polyhedra the best separating axis is a face normal of one or a cross product of
// two edges. The largest separation over those axes is exactly minus the penetration depth when
// they overlap, and a lower bound of their distance, never zero or less, when they don't
// (Gottschalk, Lin, Manocha: OBBTree, 1996). So its sign decides collision exactly.
#pragma once

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

// Two equal convex modules of a given size, by separating axes.
class Solid {
 public:
  Solid(const Hull &hull, double size);

  // Separation of two modules: from the centre of a to that of b leads `gap`, in pitches. The
  // search stops when the separation is known to be at least `enough`.
  Separation separation(const Vector<double> &gap, const Matrix<double> &a, const Matrix<double> &b,
                        double enough) const {
    return is_box_ ? box_separation(gap, a, b, enough) : hull_separation(gap, a, b, enough);
  }

  // Radius of the ball about the centre that the module lies in, in pitches.
  double radius() const { return hull_.radius * size_; }

 private:
  Separation box_separation(const Vector<double> &gap, const Matrix<double> &a,
                            const Matrix<double> &b, double enough) const;
  Separation hull_separation(const Vector<double> &gap, const Matrix<double> &a,
                             const Matrix<double> &b, double enough) const;
  double separation_along(const Vector<double> &axis, const Vector<double> &gap,
                          const Matrix<double> &a, const Matrix<double> &b) const;

  Hull hull_;
  double size_;
  bool is_box_;
  double half_[3];  // of a box along its axes, in pitches
};

}  // namespace foldback
