// Inverse dynamics of a free chain by Newton and Euler: linear in its modules.
//
// Accelerations are propagated outwards from module 0, forces inwards from the last module
// (recursive Newton–Euler algorithm; Featherstone, Rigid Body Dynamics Algorithms, 2008, chapter
// 5).
#include <algorithm>
#include <limits>
#include <vector>

#include "module_bindings.hpp"
#include "spatial.hpp"

namespace foldback {

namespace {

// A module, or the lump of an end, in the frame of module 0.
struct FloatingBody {
  double mass;
  Vector<double> position;    // centre of mass
  Symmetric<double> inertia;  // about the centre of mass
  Vector<double> velocity, omega, acceleration, alpha;
  Vector<double> arm;     // centre of mass relative to that of the chain
  Vector<double> moment;  // torque, or angular momentum, about the centre of mass
};

// R diag(inertia) Rᵀ.
Symmetric<double> turned_inertia(const Matrix<double> &R, const double *inertia) {
  auto element = [&](int a, int b) {
    return R(a, 0) * R(b, 0) * inertia[0] + R(a, 1) * R(b, 1) * inertia[1] +
           R(a, 2) * R(b, 2) * inertia[2];
  };
  return {element(0, 0), element(0, 1), element(0, 2), element(1, 1), element(1, 2), element(2, 2)};
}

// Acceleration of a body's point at `arm`: a + α × arm + ω × (ω × arm).
Vector<double> shifted(const Vector<double> &a, const Vector<double> &alpha,
                       const Vector<double> &omega, const Vector<double> &arm) {
  return a + cross(alpha, arm) + cross(omega, cross(omega, arm));
}

// Hinge torques of motions of a free chain that has no momentum, one configuration after the other.
class FloatingTorques {
 public:
  FloatingTorques(const Joint &joint, const double *inertia, const Lumps &lumps, Index modules)
      : joint_(joint),
        inertia_(inertia),
        lumps_(lumps),
        n_(modules),
        bodies_(modules + 2),
        pivots_(modules),
        axes_(modules * joint.hinges()) {}

  void write(View<const double, 1> q, View<const double, 1> qd, View<const double, 1> qdd,
             View<double, 1> out) {
    propagate_velocities(q, qd);
    write_composite_inertia();
    for (FloatingBody &body : bodies_) body.moment = body.inertia.times(body.omega);
    cancel_momentum(&FloatingBody::velocity, &FloatingBody::omega);
    propagate_accelerations(qd, qdd);
    write_moments();
    // Given accelerations and torques instead of velocities and angular momenta, so that the
    // chain's momentum does not change.
    cancel_momentum(&FloatingBody::acceleration, &FloatingBody::alpha);
    write_moments();
    write_hinge_torques(out);
  }

 private:
  // Write poses, axes, inertias, v and ω outwards, module 0 upright and at rest at the origin.
  void propagate_velocities(View<const double, 1> q, View<const double, 1> qd) {
    const Index hinges = joint_.hinges();
    const Matrix<double> fixed = load_matrix(joint_.turn.data());
    Matrix<double> rotation{{1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0}};
    Vector<double> position{}, velocity{}, omega{};
    for (Index i = 0; i < n_; ++i) {
      FloatingBody &body = bodies_[i];
      body.mass = 1.0;
      body.position = position;
      body.velocity = velocity;
      body.omega = omega;
      body.inertia = turned_inertia(rotation, inertia_);
      for (int end = 0; end < 2; ++end)
        if (i == end * (n_ - 1)) write_lump(end, body, rotation);
      if (i + 1 == n_) return;
      Vector<double> arm = rotate(rotation, joint_.anchor.data());
      velocity = velocity + cross(omega, arm);
      position = position + arm;
      pivots_[i] = position;
      if (Index j = joint_.first_hinge(i); j >= 0)
        for (Index k = 0; k < hinges; ++k) {
          const double *local = joint_.axes[k].data();
          Vector<double> axis = axes_[i * hinges + k] = rotate(rotation, local);
          omega = omega + scaled(axis, qd[j + k]);
          rotation = multiply(rotation, rodrigues(local, q[j + k]));
        }
      rotation = multiply(rotation, fixed);
      arm = rotate(rotation, joint_.offset.data());
      velocity = velocity + cross(omega, arm);
      position = position + arm;
    }
  }

  void write_lump(int end, const FloatingBody &module, const Matrix<double> &rotation) {
    FloatingBody &lump = bodies_[n_ + end];
    Vector<double> arm = rotate(rotation, lumps_.centres[end].data());
    lump.mass = lumps_.masses[end];
    lump.position = module.position + arm;
    lump.velocity = module.velocity + cross(module.omega, arm);
    lump.omega = module.omega;
    lump.inertia = turned_inertia(multiply(rotation, load_matrix(lumps_.axes[end].data())),
                                  lumps_.moments[end].data());
  }

  // Write a and α outwards, those of module 0 being zero. Across a hinge α' = α + s q̈ + ω × s q̇,
  // with its axis s.
  void propagate_accelerations(View<const double, 1> qd, View<const double, 1> qdd) {
    const Index hinges = joint_.hinges();
    Vector<double> alpha{}, a{};
    for (Index i = 0; i < n_; ++i) {
      FloatingBody &body = bodies_[i];
      body.acceleration = a;
      body.alpha = alpha;
      for (int end = 0; end < 2; ++end)
        if (i == end * (n_ - 1)) {
          FloatingBody &lump = bodies_[n_ + end];
          lump.acceleration = shifted(a, alpha, body.omega, lump.position - body.position);
          lump.alpha = alpha;
        }
      if (i + 1 == n_) return;
      Vector<double> omega = body.omega;
      a = shifted(a, alpha, omega, pivots_[i] - body.position);
      if (Index j = joint_.first_hinge(i); j >= 0)
        for (Index k = 0; k < hinges; ++k) {
          const Vector<double> &axis = axes_[i * hinges + k];
          alpha = alpha + scaled(axis, qdd[j + k]);
          alpha = alpha + scaled(cross(omega, axis), qd[j + k]);
          omega = omega + scaled(axis, qd[j + k]);
        }
      a = shifted(a, alpha, omega, bodies_[i + 1].position - pivots_[i]);
    }
  }

  // Write the arms, and the inertia of the whole chain about its centre of mass.
  void write_composite_inertia() {
    Vector<double> centre{};
    total_ = 0.0;
    for (const FloatingBody &body : bodies_) {
      total_ += body.mass;
      centre = centre + scaled(body.position, body.mass);
    }
    whole_ = {};
    for (FloatingBody &body : bodies_) {
      body.arm =
          body.position - Vector<double>{centre.x / total_, centre.y / total_, centre.z / total_};
      const double m = body.mass;
      const auto &[x, y, z] = body.arm;
      whole_.xx += m * (y * y + z * z) + body.inertia.xx;
      whole_.yy += m * (x * x + z * z) + body.inertia.yy;
      whole_.zz += m * (x * x + y * y) + body.inertia.zz;
      whole_.xy += body.inertia.xy - m * x * y;
      whole_.xz += body.inertia.xz - m * x * z;
      whole_.yz += body.inertia.yz - m * y * z;
    }
  }

  // Add the motion of one rigid body to all bodies, so that the chain has no momentum.
  void cancel_momentum(Vector<double> FloatingBody::*linear,
                       Vector<double> FloatingBody::*angular) {
    Vector<double> momentum{}, angular_momentum{};
    for (const FloatingBody &body : bodies_) {
      Vector<double> own = scaled(body.*linear, body.mass);
      momentum = momentum + own;
      angular_momentum = angular_momentum + cross(body.arm, own) + body.moment;
    }
    Vector<double> rigid = whole_.solve(scaled(angular_momentum, -1.0));
    Vector<double> drift{momentum.x / total_, momentum.y / total_, momentum.z / total_};
    for (FloatingBody &body : bodies_) {
      body.*linear = body.*linear + (cross(rigid, body.arm) - drift);
      body.*angular = body.*angular + rigid;
    }
  }

  // Write the torques of rotation about the centres of mass: I α + ω × I ω.
  void write_moments() {
    for (FloatingBody &body : bodies_)
      body.moment =
          body.inertia.times(body.alpha) + cross(body.omega, body.inertia.times(body.omega));
  }

  // Write hinge torques: the moment about each axis that all modules beyond it need. Force and
  // moment about the origin are summed inwards from the last module.
  void write_hinge_torques(View<double, 1> out) const {
    const Index hinges = joint_.hinges();
    const FloatingBody &lump = bodies_[n_ + 1];
    Vector<double> force = scaled(lump.acceleration, lump.mass);
    Vector<double> moment = cross(lump.position, force) + lump.moment;
    for (Index i = n_ - 1; i > joint_.rigid_links; --i) {
      const FloatingBody &body = bodies_[i];
      force = force + body.acceleration;
      moment = moment + cross(body.position, body.acceleration) + body.moment;
      Vector<double> about_pivot = moment - cross(pivots_[i - 1], force);
      for (Index k = 0; k < hinges; ++k)
        out[joint_.first_hinge(i - 1) + k] = dot(axes_[(i - 1) * hinges + k], about_pivot);
    }
  }

  const Joint &joint_;
  const double *inertia_;
  const Lumps &lumps_;
  Index n_;
  std::vector<FloatingBody> bodies_;    // the modules, then the lumps of the first and the last one
  std::vector<Vector<double>> pivots_;  // centres of the joints to the next modules
  std::vector<Vector<double>> axes_;    // of those joints
  Symmetric<double> whole_{};
  double total_ = 0.0;
};

}  // namespace

void bind_floating_torques(nanobind::module_ &m) {
  namespace nb = nanobind;
  m.def(
      "many_floating_torques",
      [](View<const double, 2> q, View<const double, 2> qd, View<const double, 2> qdd, Joint joint,
         View<const double, 1> inertia, Lumps lumps, View<double, 2> out) {
        require_joint(joint);
        require_lumps(lumps);
        require(joint.hinges() > 0, "joint.axes: at least one hinge");
        require(q.axis(1) % joint.hinges() == 0, "q: (F, J), all hinges of joints");
        require(qd.shape() == q.shape() && qdd.shape() == q.shape() && out.shape() == q.shape(),
                "q, qd, qdd, out: (F, J)");
        require(inertia.size() == 3, "inertia: (3,)");
        nb::gil_scoped_release release;
        FloatingTorques torques(joint, inertia.data(), lumps,
                                q.axis(1) / joint.hinges() + 1 + joint.rigid_links);
        for (Index f = 0; f < q.size(); ++f) torques.write(q[f], qd[f], qdd[f], out[f]);
      },
      nb::arg("q"), nb::arg("qd"), nb::arg("qdd"), nb::arg("joint"), nb::arg("inertia"),
      nb::arg("lumps"), nb::arg("out"),
      "Write the (F, J) hinge torques of motions of a free chain that has no momentum.");
}

}  // namespace foldback
