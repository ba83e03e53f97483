// Motion of all modules about one moment, with bounds over an interval around it.
//
// Lemmas 1 to 4 of docs/decisions/0012-sweep-bound.md. Hinge angles run evenly: q(s) = q + s q̇ for
// |s| ≤ h. A module's pose and its first and second derivatives at s = 0 are exact, in the frame of
// the root module, which is held still; higher ones are bounded over all |s| ≤ h. Lengths are in
// pitches; a unit of time is the interval between two frames.
//
// The bounds grow with actual angular velocities, and not only with the sum of the hinge rates.
#pragma once

#include <algorithm>
#include <cmath>

#include "module.hpp"
#include "vectors.hpp"

namespace foldback {

// Motion of one module: a row of BODY_COLUMNS numbers in Python.
struct Body {
  Vector<double> position;
  Matrix<double> rotation;
  Vector<double> velocity, acceleration, omega, alpha;  // alpha is ω'
  double speed_bound;                                   // W of |ω| over |s| ≤ h: lemma 2
  double acceleration_bound;                            // A of |ω'|
  double angular_jerk_bound;                            // T of |ω''|
  double jerk_bound;                                    // J of |p'''|: lemma 3
  double displacement_bound;  // D of the centre's displacement from s = 0: lemma 4
  double rate_sum;            // Σ|q̇| over the hinges from the root on, negative on its other side
};
constexpr Index BODY_COLUMNS = 30;
static_assert(sizeof(Body) == BODY_COLUMNS * sizeof(double));

inline double length(const Vector<double> &v) {
  return std::sqrt(v.x * v.x + v.y * v.y + v.z * v.z);
}

// Longest way from a module's centre by a joint to the next one's, in pitches.
inline double longest_link(const Joint &joint) {
  double longest = 0.0;
  for (Index r = 0; r < joint.anchor.size(); ++r)
    longest = std::max(longest,
                       length(load(joint.anchor[r].data())) + length(load(joint.offset[r].data())));
  return longest;
}

// The bound B of |r'''| for a vector r of length 1 fixed in a body: lemma 2.
inline double rotation_jerk_bound(const Body &body) {
  double w = body.speed_bound;
  return body.angular_jerk_bound + 3.0 * w * body.acceleration_bound + w * w * w;
}

// Motion of a module that is rigidly joined to the module `last`, at a pose in its frame: lemma 4.
Body rod_body(const Body &last, const double *place, const Matrix<double> &rotation, double half);

// Write all bodies of a stretch of a chain: lemmas 1 to 4. Angles and rates are those of its joints
// at s = 0; the pose of the root, which is held still, is given.
void move_bodies(View<const double, 1> angles, View<const double, 1> rates, double half,
                 const Joint &joint, Index root, View<Body, 1> bodies);

// Motion of a body b relative to a body a: lemmas 5 and 6. A row of RELATIVE_COLUMNS numbers in
// Python.
struct RelativeMotion {
  Vector<double> velocity, acceleration, omega;  // u, e and ψ as seen from a at s = 0
  double remainder;                              // how near any point of b gets besides these
};
constexpr Index RELATIVE_COLUMNS = 10;
static_assert(sizeof(RelativeMotion) == RELATIVE_COLUMNS * sizeof(double));

// How near a body b may get to a body a.
struct Approach {
  RelativeMotion motion;
  double loss;      // pitches by which any point of b may get nearer, along whatever axis
  double distance;  // of the centres at s = 0
};

// Bound how near body b gets to body a within |s| ≤ half: lemmas 5 and 6. `radius` is ρ, of the
// ball about a module, `reach` the greatest length of the links between the two that move against
// each other: the number k of them, where each is one pitch long.
Approach approach_of(const Body &a, const Body &b, double half, double radius, double reach);

// loss(n) of lemma 6: how near any point of b gets along a unit axis fixed in a.
double loss_along(const RelativeMotion &motion, const Vector<double> &axis, double half,
                  double radius);

}  // namespace foldback
