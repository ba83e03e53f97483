#include "motion_bounds.hpp"

#include <algorithm>

#include "module_bindings.hpp"

namespace foldback {

namespace {

// Bounds over |s| ≤ h for the centre c of a joint: lemma 3.
struct JointBounds {
  double distance;  // of |c − p| to the root's centre p, in pitches
  double speed, acceleration;
};

// Sums of |q̇| times bounds over the hinges between the root and a module: lemmas 2 and 3. The axis
// of a hinge is n, the centre of its joint c.
struct LeverSums {
  double rate = 0.0;                              // Σ |q̇|
  double axis_speed = 0.0;                        // Σ |q̇| |n'|
  double axis_acceleration = 0.0;                 // Σ |q̇| |n''|
  double axis_speed_times_speed = 0.0;            // Σ |q̇| |n'| |c'|
  double axis_acceleration_times_distance = 0.0;  // Σ |q̇| |n''| |c|
  double acceleration = 0.0;                      // Σ |q̇| |c''|
};

// Move a point by a vector r fixed in a body: lemma 1. Adds r to its position, ω × r to its
// velocity, and ω' × r + ω × (ω × r) to its acceleration. The point may be the body's centre.
void shift(const Body &body, const Vector<double> &r, Body &point) {
  const Vector<double> &w = body.omega, &u = body.alpha;
  Vector<double> v = cross(w, r);
  Vector<double> tangential{u.y * r.z - u.z * r.y + w.y * v.z - w.z * v.y,
                            u.z * r.x - u.x * r.z + w.z * v.x - w.x * v.z,
                            u.x * r.y - u.y * r.x + w.x * v.y - w.y * v.x};
  point.position = point.position + r;
  point.velocity = point.velocity + v;
  point.acceleration = point.acceleration + tangential;
}

double root_distance(const Body &body, const Body &root) {
  return length(body.position - root.position);
}

// The bounds for a joint whose centre is fixed in a body, `arm` from its centre.
JointBounds joint_bounds(const Body &body, const Body &root, double arm, double half) {
  double w = body.speed_bound, u = body.acceleration_bound;
  double speed = length(body.velocity), acceleration = length(body.acceleration);
  double distance = root_distance(body, root) + (body.displacement_bound + arm);
  double fast = speed + half * (acceleration + 0.5 * half * body.jerk_bound) + arm * w;
  return {distance, fast, acceleration + (half * body.jerk_bound + arm * (u + w * w))};
}

// Add the turn of a hinge about the unit vector n in the root's frame, at a rate q̇ outwards from
// the root, to ω, ω' and their bounds: lemmas 1 and 2.
void pass_hinge(Body &body, const Vector<double> &n, double rate, double half,
                const JointBounds &centre, LeverSums &sums) {
  body.alpha = body.alpha + scaled(cross(body.omega, n), rate);
  body.omega = body.omega + scaled(n, rate);
  double size = std::abs(rate);
  double w = body.speed_bound, u = body.acceleration_bound;  // |n'| ≤ w
  double bent = size * (u + w * w);                          // |q̇| |n''|
  sums.rate += size;
  sums.axis_speed += size * w;
  sums.axis_acceleration += bent;
  sums.axis_speed_times_speed += size * w * centre.speed;
  sums.axis_acceleration_times_distance += bent * centre.distance;
  sums.acceleration += size * centre.acceleration;
  double jerk = body.angular_jerk_bound + bent;
  u = length(body.alpha);
  w = length(body.omega);
  body.angular_jerk_bound = jerk;
  body.acceleration_bound = std::min(u + half * jerk, 0.5 * sums.rate * sums.rate);
  body.speed_bound = std::min(w + half * (u + 0.5 * half * jerk), sums.rate);
}

// Write the bounds of jerk and displacement of a body's centre: lemmas 3 and 4. `jerk` is the bound
// of |p'''| link by link, `reach` the length of the chain between the root and the body.
void bound_centre(Body &body, const Body &root, double jerk, double half, const LeverSums &sums,
                  double reach) {
  double speed = length(body.velocity), acceleration = length(body.acceleration);
  // J ≤ L + λ J of lemma 3; this is 1 − λ.
  double rest =
      1.0 - half * (sums.rate + half * (sums.axis_speed + half * sums.axis_acceleration / 6.0));
  if (rest > 0.0) {
    double distance = root_distance(body, root) + half * (speed + 0.5 * half * acceleration);
    double lever = sums.axis_acceleration * distance + sums.axis_acceleration_times_distance +
                   sums.rate * acceleration + sums.acceleration;
    lever += 2.0 * (sums.axis_speed * (speed + half * acceleration) + sums.axis_speed_times_speed);
    jerk = std::min(jerk, lever / rest);
  }
  body.jerk_bound = jerk;
  body.displacement_bound = std::min(
      half * (speed + half * (0.5 * acceleration + half * jerk / 6.0)), half * sums.rate * reach);
}

// The joints of a stretch as they are met on the way from the root to one end: `step` is 1 or −1.
class OutwardPass {
 public:
  OutwardPass(View<const double, 1> angles, View<const double, 1> rates, double half,
              const Joint &joint, int step)
      : angles_(angles),
        rates_(rates),
        half_(half),
        joint_(joint),
        step_(step),
        longest_(longest_link(joint)) {}

  void run(Index root, View<Body, 1> bodies) {
    const Index last = step_ > 0 ? bodies.size() - 1 : 0;
    for (Index i = root; i != last; i += step_) pass_joint(i, bodies[root], root, bodies);
  }

 private:
  // Take the row of the table that the joint behind module i has.
  void take_row(Index i) {
    const Index row = joint_.row(i);
    if (row == row_) return;
    row_ = row;
    kind_ = joint_.of_row(row);
    near_ = step_ > 0 ? kind_.anchor.data() : kind_.offset.data();
    far_ = step_ > 0 ? kind_.offset.data() : kind_.anchor.data();
    near_arm_ = length(load(near_));
    far_arm_ = length(load(far_));
    turn_ = load_matrix(kind_.turn.data());
  }

  // Write the body behind the joint of body i.
  void pass_joint(Index i, const Body &root_body, Index root, View<Body, 1> bodies) {
    const Index next = i + step_, link = std::min(i, next) - joint_.rigid_links;
    take_row(std::min(i, next));
    const Body &a = bodies[i];
    Body b = a;
    Matrix<double> frame = a.rotation;
    shift(a, scaled(rotate(frame, near_), static_cast<double>(step_)), b);  // to the joint
    if (step_ < 0) frame = multiply(frame, transpose(turn_));
    if (link >= 0) turn_hinges(link, a, root_body, frame, b);
    if (step_ > 0) frame = multiply(frame, turn_);
    b.rotation = frame;
    shift(b, scaled(rotate(frame, far_), static_cast<double>(step_)), b);  // to its own centre
    double jerk = a.jerk_bound + near_arm_ * rotation_jerk_bound(a);
    jerk += far_arm_ * rotation_jerk_bound(b);
    bound_centre(b, root_body, jerk, half_, sums_,
                 static_cast<double>(std::abs(next - root)) * longest_);
    b.rate_sum = root_body.rate_sum + step_ * sums_.rate;
    bodies[next] = b;
  }

  void turn_hinges(Index link, const Body &a, const Body &root, Matrix<double> &frame, Body &b) {
    const JointBounds centre = joint_bounds(a, root, near_arm_, half_);
    const Index hinges = joint_.hinges();
    for (Index at = 0; at < hinges; ++at) {
      Index k = step_ > 0 ? at : hinges - 1 - at;
      const double *axis = kind_.axes[k].data();
      double rate = rates_[link * hinges + k], angle = angles_[link * hinges + k];
      if (rate != 0.0) pass_hinge(b, rotate(frame, axis), rate * step_, half_, centre, sums_);
      if (angle != 0.0) frame = multiply(frame, rodrigues(axis, angle * step_));
    }
  }

  View<const double, 1> angles_, rates_;
  double half_;
  const Joint &joint_;
  int step_;
  double longest_;
  // Of the joint at hand.
  Index row_ = -1;
  JointKind kind_;
  const double *near_ = nullptr, *far_ = nullptr;
  double near_arm_ = 0.0, far_arm_ = 0.0;
  Matrix<double> turn_{};
  LeverSums sums_;
};

// The bound X + ρ Q of the third derivative of any point of b as seen from a: lemma 5. Distances
// and their derivatives are |d|, |d'| and |d''| at s = 0, those of the spin |ψ|, |ψ'| and |y'|.
struct Magnitudes {
  double distance, speed, acceleration, spin, spin_rate, difference_rate;
};

double third_derivative_bound(const Body &a, const Body &b, double half, double radius,
                              double reach, Magnitudes m) {
  double rates = std::abs(b.rate_sum - a.rate_sum);  // S
  double cube = rates * rates * rates;
  double w = a.speed_bound, u = a.acceleration_bound;
  // Taylor bounds |d|, |d'| and |d''| over the interval; then X.
  double jerk = a.jerk_bound + b.jerk_bound;
  double speed = m.speed + half * (m.acceleration + 0.5 * half * jerk);
  double acceleration = m.acceleration + half * jerk;
  double distance = m.distance + half * speed;
  jerk += 3.0 * (w * acceleration + (u + w * w) * speed) + rotation_jerk_bound(a) * distance;
  jerk = std::min(jerk, cube * reach);
  // The same for |y|, then Ψ, the bounds of |ψ'| and |ψ|, and Q.
  double angular_jerk = a.angular_jerk_bound + b.angular_jerk_bound;
  double difference = m.spin + half * (m.difference_rate + 0.5 * half * angular_jerk);
  angular_jerk += 2.0 * w * (u + b.acceleration_bound) + (u + w * w) * difference;
  angular_jerk = std::min(angular_jerk, 0.5 * cube);
  double max_spin_rate = m.spin_rate + half * angular_jerk;
  double max_spin = std::min(m.spin + half * (m.spin_rate + 0.5 * half * angular_jerk), rates);
  double rotation_jerk =
      angular_jerk + 3.0 * max_spin * max_spin_rate + max_spin * max_spin * max_spin;
  return jerk + radius * std::min(rotation_jerk, cube);
}

}  // namespace

Body rod_body(const Body &last, const double *place, const Matrix<double> &rotation, double half) {
  Body body = last;
  Vector<double> r = rotate(last.rotation, place);
  body.rotation = multiply(last.rotation, rotation);
  shift(last, r, body);
  double away = length(r);
  body.jerk_bound += away * rotation_jerk_bound(last);
  body.displacement_bound += away * std::min(2.0, half * last.speed_bound);
  return body;
}

void move_bodies(View<const double, 1> angles, View<const double, 1> rates, double half,
                 const Joint &joint, Index root, View<Body, 1> bodies) {
  Body still{};
  still.position = bodies[root].position;
  still.rotation = bodies[root].rotation;
  bodies[root] = still;
  OutwardPass(angles, rates, half, joint, 1).run(root, bodies);
  OutwardPass(angles, rates, half, joint, -1).run(root, bodies);
}

Approach approach_of(const Body &a, const Body &b, double half, double radius, double reach) {
  const Vector<double> d = b.position - a.position, v = b.velocity - a.velocity;
  const Vector<double> acceleration = b.acceleration - a.acceleration;
  const Vector<double> &w = a.omega, &t = a.alpha;
  RelativeMotion motion;
  // Lemma 5: u = d' − ω × d and e = d'' − ω' × d − 2 ω × d' + ω × (ω × d).
  Vector<double> c = cross(w, d);
  motion.velocity = v - c;
  Vector<double> e = c - scaled(v, 2.0);
  motion.acceleration = {acceleration.x - (t.y * d.z - t.z * d.y) + w.y * e.z - w.z * e.y,
                         acceleration.y - (t.z * d.x - t.x * d.z) + w.z * e.x - w.x * e.z,
                         acceleration.z - (t.x * d.y - t.y * d.x) + w.x * e.y - w.y * e.x};
  // ψ = y = ω_b − ω_a, and ψ' = y' − ω_a × y.
  motion.omega = b.omega - w;
  Vector<double> difference_rate = b.alpha - t;
  Magnitudes magnitudes{length(d),
                        length(v),
                        length(acceleration),
                        length(motion.omega),
                        length(difference_rate - cross(w, motion.omega)),
                        length(difference_rate)};
  double spin = magnitudes.spin;
  double third = third_derivative_bound(a, b, half, radius, reach, magnitudes);
  motion.remainder = 0.5 * half * half * radius * (magnitudes.spin_rate + spin * spin);
  motion.remainder += half * half * half / 6.0 * third;
  double loss =
      half * (length(motion.velocity) + 0.5 * half * length(motion.acceleration) + radius * spin) +
      motion.remainder;
  return {motion, loss, magnitudes.distance};
}

double loss_along(const RelativeMotion &motion, const Vector<double> &axis, double half,
                  double radius) {
  double speed = std::abs(dot(axis, motion.velocity));
  double acceleration = std::abs(dot(axis, motion.acceleration));
  double spin = length(cross(axis, motion.omega));
  return half * (speed + 0.5 * half * acceleration + radius * spin) + motion.remainder;
}

namespace {

const Body &body_at(View<const double, 1> row) {
  require(row.size() == BODY_COLUMNS, "a body: (BODY_COLUMNS,)");
  return *reinterpret_cast<const Body *>(row.data());
}

}  // namespace

void bind_motion_bounds(nanobind::module_ &m) {
  namespace nb = nanobind;
  m.attr("BODY_COLUMNS") = BODY_COLUMNS;
  m.attr("RELATIVE_COLUMNS") = RELATIVE_COLUMNS;
  m.attr("ROTATION") = offsetof(Body, rotation) / sizeof(double);
  m.attr("VELOCITY") = offsetof(Body, velocity) / sizeof(double);
  m.attr("DISPLACEMENT_BOUND") = offsetof(Body, displacement_bound) / sizeof(double);
  m.def(
      "rod_body",
      [](View<const double, 1> last, View<const double, 1> place, View<const double, 2> rotation,
         double half, View<double, 1> body) {
        require(place.size() == 3, "place: (3,)");
        require(rotation.shape() == std::array<Index, 2>{3, 3}, "rotation: (3, 3)");
        require(body.size() == BODY_COLUMNS, "body: (BODY_COLUMNS,)");
        *reinterpret_cast<Body *>(body.data()) =
            rod_body(body_at(last), place.data(), load_matrix(rotation.data()), half);
      },
      nb::arg("last"), nb::arg("place"), nb::arg("rotation"), nb::arg("half"), nb::arg("body"),
      "Write the body of a module that is rigidly joined to the module `last`: lemma 4.");
  m.def(
      "move_bodies",
      [](View<const double, 1> angles, View<const double, 1> rates, double half, Joint joint,
         Index root, View<double, 2> bodies) {
        require_joint(joint);
        Index count = bodies.size();
        require(bodies.axis(1) == BODY_COLUMNS, "bodies: (m, BODY_COLUMNS)");
        require(root >= 0 && root < count, "root: an index of a body");
        Index J = std::max<Index>(0, joint.first_hinge(count - 1));
        require(angles.size() == J && rates.size() == J, "angles, rates: those of the stretch");
        move_bodies(angles, rates, half, joint, root,
                    View<Body, 1>(reinterpret_cast<Body *>(bodies.data()), {count}));
      },
      nb::arg("angles"), nb::arg("rates"), nb::arg("half"), nb::arg("joint"), nb::arg("root"),
      nb::arg("bodies"), "Write all bodies of a stretch of a chain: lemmas 1 to 4.");
  m.def(
      "relative_motion_bound",
      [](View<const double, 1> a, View<const double, 1> b, double half, double radius, double reach,
         View<double, 1> relative) {
        require(relative.size() == RELATIVE_COLUMNS, "relative: (RELATIVE_COLUMNS,)");
        Approach approach = approach_of(body_at(a), body_at(b), half, radius, reach);
        *reinterpret_cast<RelativeMotion *>(relative.data()) = approach.motion;
        return nb::make_tuple(approach.loss, approach.distance);
      },
      nb::arg("a"), nb::arg("b"), nb::arg("half"), nb::arg("radius"), nb::arg("reach"),
      nb::arg("relative"), "Bound how near body b gets to body a: lemmas 5 and 6.");
  m.def(
      "directional_motion_bound",
      [](View<const double, 1> relative, View<const double, 1> axis, double half, double radius) {
        require(relative.size() == RELATIVE_COLUMNS, "relative: (RELATIVE_COLUMNS,)");
        require(axis.size() == 3, "axis: (3,)");
        return loss_along(*reinterpret_cast<const RelativeMotion *>(relative.data()),
                          load(axis.data()), half, radius);
      },
      nb::arg("relative"), nb::arg("axis"), nb::arg("half"), nb::arg("radius"),
      "Return how near any point of b gets along an axis fixed in a: lemma 6.");
}

}  // namespace foldback
