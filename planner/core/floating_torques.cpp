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
  Vector<Lanes> position;    // centre of mass
  Symmetric<Lanes> inertia;  // about the centre of mass
  Vector<Lanes> velocity, omega, acceleration, alpha;
  Vector<Lanes> arm;     // centre of mass relative to that of the chain
  Vector<Lanes> moment;  // torque, or angular momentum, about the centre of mass
};

// R diag(mass · moments) Rᵀ.
Symmetric<Lanes> turned_inertia(const Matrix<Lanes> &R, double mass, const double *moments) {
  auto element = [&](int a, int b) {
    return R(a, 0) * R(b, 0) * (mass * moments[0]) + R(a, 1) * R(b, 1) * (mass * moments[1]) +
           R(a, 2) * R(b, 2) * (mass * moments[2]);
  };
  return {element(0, 0), element(0, 1), element(0, 2), element(1, 1), element(1, 2), element(2, 2)};
}

// Acceleration of a body's point at `arm`: a + α × arm + ω × (ω × arm).
Vector<Lanes> shifted(const Vector<Lanes> &a, const Vector<Lanes> &alpha,
                      const Vector<Lanes> &omega, const Vector<Lanes> &arm) {
  return a + cross(alpha, arm) + cross(omega, cross(omega, arm));
}

// Hinge torques of motions of a free chain that has no momentum. Four configurations are the lanes
// of one vector, each computed as it would be by itself.
class FloatingTorques {
 public:
  explicit FloatingTorques(const ChainModel &model)
      : joint_(model.joint),
        masses_(model.masses),
        inertia_(model.inertia),
        lumps_(model.lumps),
        n_(model.masses.size()),
        bodies_(n_ + 2),
        links_(n_),
        axes_(n_ * joint_.hinges()) {}

  // Place the chain with (J,) hinge angles.
  void place(const Lanes *q) {
    write_poses(q);
    write_composite_inertia();
  }

  // Write the (J,) torques of a motion of the chain that is placed.
  void write(const Lanes *qd, const Lanes *qdd, Lanes *out) {
    propagate_velocities(qd);
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
  // Link to the next module: from the module's centre to the joint's, and on to the next module's.
  struct Link {
    Vector<Lanes> to_pivot, pivot, from_pivot;
  };

  // Write poses, axes and inertias outwards, module 0 upright at the origin.
  void write_poses(const Lanes *q) {
    const Index hinges = joint_.hinges();
    Matrix<Lanes> rotation{};
    for (int r = 0; r < 3; ++r) rotation(r, r) += 1.0;
    Vector<Lanes> position{};
    for (Index i = 0; i < n_; ++i) {
      FloatingBody &body = bodies_[i];
      body.mass = masses_[i];
      body.position = position;
      body.inertia = turned_inertia(rotation, body.mass, inertia_[joint_.row(i)].data());
      for (int end = 0; end < 2; ++end)
        if (i == end * (n_ - 1)) place_lump(end, position, rotation);
      if (i + 1 == n_) return;
      Link &link = links_[i];
      const JointKind kind = joint_.at(i);
      link.to_pivot = rotate(rotation, kind.anchor.data());
      link.pivot = position + link.to_pivot;
      if (Index j = joint_.first_hinge(i); j >= 0)
        for (Index k = 0; k < hinges; ++k) {
          const double *local = kind.axes[k].data();
          axes_[i * hinges + k] = rotate(rotation, local);
          rotation = multiply(rotation, rodrigues(local, q[j + k]));
        }
      rotation = multiply(rotation, load_matrix(kind.turn.data()));
      link.from_pivot = rotate(rotation, kind.offset.data());
      position = link.pivot + link.from_pivot;
    }
  }

  void place_lump(int end, const Vector<Lanes> &position, const Matrix<Lanes> &rotation) {
    FloatingBody &lump = bodies_[n_ + end];
    lump_arms_[end] = rotate(rotation, lumps_.centres[end].data());
    lump.mass = lumps_.masses[end];
    lump.position = position + lump_arms_[end];
    lump.inertia = turned_inertia(multiply(rotation, load_matrix(lumps_.axes[end].data())), 1.0,
                                  lumps_.moments[end].data());
  }

  // Write v and ω outwards, module 0 being at rest.
  void propagate_velocities(const Lanes *qd) {
    const Index hinges = joint_.hinges();
    Vector<Lanes> velocity{}, omega{};
    for (Index i = 0; i < n_; ++i) {
      bodies_[i].velocity = velocity;
      bodies_[i].omega = omega;
      for (int end = 0; end < 2; ++end)
        if (i == end * (n_ - 1)) {
          bodies_[n_ + end].velocity = velocity + cross(omega, lump_arms_[end]);
          bodies_[n_ + end].omega = omega;
        }
      if (i + 1 == n_) return;
      velocity = velocity + cross(omega, links_[i].to_pivot);
      if (Index j = joint_.first_hinge(i); j >= 0)
        for (Index k = 0; k < hinges; ++k) omega = omega + scaled(axes_[i * hinges + k], qd[j + k]);
      velocity = velocity + cross(omega, links_[i].from_pivot);
    }
  }

  // Write a and α outwards, those of module 0 being zero. Across a hinge α' = α + s q̈ + ω × s q̇,
  // with its axis s.
  void propagate_accelerations(const Lanes *qd, const Lanes *qdd) {
    const Index hinges = joint_.hinges();
    Vector<Lanes> alpha{}, a{};
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
      const Vector<Lanes> &pivot = links_[i].pivot;
      Vector<Lanes> omega = body.omega;
      a = shifted(a, alpha, omega, pivot - body.position);
      if (Index j = joint_.first_hinge(i); j >= 0)
        for (Index k = 0; k < hinges; ++k) {
          const Vector<Lanes> &axis = axes_[i * hinges + k];
          alpha = alpha + scaled(axis, qdd[j + k]);
          alpha = alpha + scaled(cross(omega, axis), qd[j + k]);
          omega = omega + scaled(axis, qd[j + k]);
        }
      a = shifted(a, alpha, omega, bodies_[i + 1].position - pivot);
    }
  }

  // Write the arms, and the inertia of the whole chain about its centre of mass.
  void write_composite_inertia() {
    Vector<Lanes> centre{};
    total_ = 0.0;
    for (const FloatingBody &body : bodies_) {
      total_ += body.mass;
      centre = centre + scaled(body.position, body.mass);
    }
    whole_ = Symmetric<Lanes>{};
    for (FloatingBody &body : bodies_) {
      body.arm =
          body.position - Vector<Lanes>{centre.x / total_, centre.y / total_, centre.z / total_};
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
  void cancel_momentum(Vector<Lanes> FloatingBody::*linear, Vector<Lanes> FloatingBody::*angular) {
    Vector<Lanes> momentum{}, angular_momentum{};
    for (const FloatingBody &body : bodies_) {
      Vector<Lanes> own = scaled(body.*linear, body.mass);
      momentum = momentum + own;
      angular_momentum = angular_momentum + cross(body.arm, own) + body.moment;
    }
    Vector<Lanes> rigid = whole_.solve(scaled(angular_momentum, -1.0));
    Vector<Lanes> drift{momentum.x / total_, momentum.y / total_, momentum.z / total_};
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
  void write_hinge_torques(Lanes *out) const {
    const Index hinges = joint_.hinges();
    const FloatingBody &lump = bodies_[n_ + 1];
    Vector<Lanes> force = scaled(lump.acceleration, lump.mass);
    Vector<Lanes> moment = cross(lump.position, force) + lump.moment;
    for (Index i = n_ - 1; i > joint_.rigid_links; --i) {
      const FloatingBody &body = bodies_[i];
      const Vector<Lanes> own = scaled(body.acceleration, body.mass);
      force = force + own;
      moment = moment + cross(body.position, own) + body.moment;
      Vector<Lanes> about_pivot = moment - cross(links_[i - 1].pivot, force);
      for (Index k = 0; k < hinges; ++k)
        out[joint_.first_hinge(i - 1) + k] = dot(axes_[(i - 1) * hinges + k], about_pivot);
    }
  }

  const Joint &joint_;
  View<const double, 1> masses_;
  View<const double, 2> inertia_;
  const Lumps &lumps_;
  Index n_;
  std::vector<FloatingBody> bodies_;  // the modules, then the lumps of the first and the last one
  std::vector<Link> links_;           // from each module to the next one
  std::vector<Vector<Lanes>> axes_;   // of the hinges in those links
  Vector<Lanes> lump_arms_[2];        // from the centres of the first and the last module
  Symmetric<Lanes> whole_{};
  double total_ = 0.0;
};

// Rows of a (F, J) array as lanes: (J,) of four rows from f on, the last row standing for those
// behind it.
class LaneRows {
 public:
  explicit LaneRows(Index columns) : lanes_(columns) {}
  Lanes *data() { return lanes_.data(); }

  void load(View<const double, 2> rows, Index f) {
    for (int lane = 0; lane < LANES; ++lane) {
      View<const double, 1> row = rows[std::min(f + lane, rows.size() - 1)];
      for (Index j = 0; j < row.size(); ++j) lanes_[j][lane] = row[j];
    }
  }

  void store(View<double, 2> rows, Index f) const {
    for (int lane = 0; lane < LANES && f + lane < rows.size(); ++lane) {
      View<double, 1> row = rows[f + lane];
      for (Index j = 0; j < row.size(); ++j) row[j] = lanes_[j][lane];
    }
  }

 private:
  std::vector<Lanes> lanes_;
};

void require_configurations_of(View<const double, 2> q, const ChainModel &model) {
  require_model(model);
  const Index hinges = model.joint.first_hinge(model.masses.size() - 1);
  require(q.axis(1) == std::max<Index>(0, hinges), "q: (F, J) of that many modules");
}

void many_floating_torques(View<const double, 2> q, View<const double, 2> qd,
                           View<const double, 2> qdd, ChainModel model, View<double, 2> out) {
  require_configurations_of(q, model);
  FloatingTorques torques(model);
  require(qd.shape() == q.shape() && qdd.shape() == q.shape() && out.shape() == q.shape(),
          "q, qd, qdd, out: (F, J)");
  nanobind::gil_scoped_release release;
  LaneRows angles(q.axis(1)), rates(q.axis(1)), accelerations(q.axis(1)), result(q.axis(1));
  for (Index f = 0; f < q.size(); f += LANES) {
    angles.load(q, f);
    rates.load(qd, f);
    accelerations.load(qdd, f);
    torques.place(angles.data());
    torques.write(rates.data(), accelerations.data(), result.data());
    result.store(out, f);
  }
}

// Write a and b of the torques a ü + b u̇² along a path: those of q̇ = 0, q̈ = q' and of q̇ = q',
// q̈ = q''.
void many_path_torques(View<const double, 2> q, View<const double, 2> first,
                       View<const double, 2> second, ChainModel model, View<double, 2> a,
                       View<double, 2> b) {
  require_configurations_of(q, model);
  FloatingTorques torques(model);
  require(first.shape() == q.shape() && second.shape() == q.shape(), "q, first, second: (F, J)");
  require(a.shape() == q.shape() && b.shape() == q.shape(), "a, b: (F, J)");
  nanobind::gil_scoped_release release;
  LaneRows angles(q.axis(1)), slopes(q.axis(1)), bends(q.axis(1)), result(q.axis(1));
  const std::vector<Lanes> still(q.axis(1));
  for (Index f = 0; f < q.size(); f += LANES) {
    angles.load(q, f);
    slopes.load(first, f);
    bends.load(second, f);
    torques.place(angles.data());
    torques.write(still.data(), slopes.data(), result.data());
    result.store(a, f);
    torques.write(slopes.data(), bends.data(), result.data());
    result.store(b, f);
  }
}

}  // namespace

void bind_floating_torques(nanobind::module_ &m) {
  namespace nb = nanobind;
  m.def("many_floating_torques", many_floating_torques, nb::arg("q"), nb::arg("qd"), nb::arg("qdd"),
        nb::arg("model"), nb::arg("out"),
        "Write the (F, J) hinge torques of motions of a free chain that has no momentum.");
  m.def("many_path_torques", many_path_torques, nb::arg("q"), nb::arg("first"), nb::arg("second"),
        nb::arg("model"), nb::arg("a"), nb::arg("b"),
        "Write (F, J) a and b of the torques a ü + b u̇² along a path q(u) of such a chain.");
}

}  // namespace foldback
