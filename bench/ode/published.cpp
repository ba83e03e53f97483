// The published algorithm, reverse explosion, on the Open Dynamics Engine (ODE).
//
// usage: published INPUT SNAPSHOTS FRAMES
//
// INPUT is text: lines "name value" of all parameters, a line "modules N", then N lines with the
// folded centre (3 numbers) and rotation matrix (9, row by row) of each module, in pitches.
// SNAPSHOTS and FRAMES receive rows of hinge angles, as doubles: all snapshots of the explosion,
// and the playback when it turns to each snapshot, and at its end. Figures go to standard output,
// as JSON.
//
// Units: cm, g, s. Module i + 1 turns about the centre of module i, first about z, then about y;
// modules 0 and 1 are one rigid body (see "Conventions" in README.md).
#include <ode/ode.h>
#include <time.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <map>
#include <string>
#include <vector>

#include "forces.hpp"

namespace {

using published::Vector;

constexpr int MAX_CONTACTS_PER_PAIR = 8;
constexpr double STRAIGHT_RAD = 0.05;   // maximum hinge angle of a chain that counts as straight
constexpr double STRAIGHT_SPAN = 0.99;  // minimum span of such a chain, as a fraction of its length
constexpr long CHECK_STEPS = 25;        // steps between two checks of a chain
constexpr long MAX_WAIT_STEPS = 3000;   // maximum steps for a snapshot; then a playback is jammed
constexpr long END_STEPS = 500;         // steps for which the folded chain is held at the end

[[noreturn]] void fail(const std::string &message) {
  std::fprintf(stderr, "%s\n", message.c_str());
  std::exit(2);
}

struct Pose {
  Vector position;
  dMatrix3 rotation;
};

struct Input {
  std::map<std::string, double> values;
  std::vector<Pose> folded;

  double operator()(const std::string &name) const {
    const auto entry = values.find(name);
    if (entry == values.end())
      fail("The input has no value of " + name + "; write a line \"" + name + " VALUE\".");
    return entry->second;
  }
};

Input read_input(const char *path) {
  std::ifstream file(path);
  Input input;
  std::string name;
  double value = 0.0;
  while (file >> name >> value) {
    if (name != "modules") {
      input.values[name] = value;
      continue;
    }
    input.folded.resize(static_cast<std::size_t>(value));
    for (Pose &pose : input.folded) {
      for (double &x : pose.position) file >> x;
      for (int row = 0; row < 3; ++row) {
        for (int column = 0; column < 3; ++column) file >> pose.rotation[4 * row + column];
        pose.rotation[4 * row + 3] = 0.0;
      }
    }
  }
  if (input.folded.size() < 3 || file.bad())
    fail(std::string("Cannot read a chain of at least 3 modules from ") + path + ".");
  return input;
}

double processor_seconds() {
  timespec now{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

// A chain of cubes in an ODE world of its own.
class Chain {
 public:
  // Build the straight chain.
  //
  // size: side of the cubes that collide, in pitches.
  // iterations: those of ODE's iterative solver; 0 for its direct solver.
  Chain(const Input &input, double size, double iterations)
      : input_(input),
        iterations_(static_cast<int>(iterations)),
        step_s_(input("step_s")),
        friction_(input("friction")),
        count_(input.folded.size()),
        world_(dWorldCreate()),
        space_(dSweepAndPruneSpaceCreate(nullptr, dSAP_AXES_XYZ)),
        contacts_(dJointGroupCreate(0)) {
    dWorldSetGravity(world_, 0.0, 0.0, 0.0);
    if (iterations_ > 0) dWorldSetQuickStepNumIterations(world_, iterations_);
    // ODE's damping: the fraction of the velocity that is lost in each step, at any speed.
    dWorldSetLinearDamping(world_, input("damping"));
    dWorldSetAngularDamping(world_, input("damping"));
    dWorldSetLinearDampingThreshold(world_, 0.0);
    dWorldSetAngularDampingThreshold(world_, 0.0);
    const double pitch = input("pitch_cm");
    dMass mass;
    dMassSetBox(&mass, 1e-3 * input("density_kg_m3"), pitch, pitch, pitch);
    const double side = pitch * size;
    for (std::size_t i = 0; i < count_; ++i) {
      const dBodyID body = dBodyCreate(world_);
      dBodySetMass(body, &mass);
      dBodySetPosition(body, pitch * static_cast<double>(i), 0.0, 0.0);
      const dGeomID geom = dCreateBox(space_, side, side, side);
      dGeomSetBody(geom, body);
      dGeomSetData(geom, reinterpret_cast<void *>(i));
      bodies_.push_back(body);
    }
    const dJointID rigid = dJointCreateFixed(world_, nullptr);
    dJointAttach(rigid, bodies_[0], bodies_[1]);
    dJointSetFixed(rigid);
    for (std::size_t i = 1; i + 1 < count_; ++i) {
      const dJointID joint = dJointCreateUniversal(world_, nullptr);
      dJointAttach(joint, bodies_[i], bodies_[i + 1]);
      dJointSetUniversalAnchor(joint, pitch * static_cast<double>(i), 0.0, 0.0);
      dJointSetUniversalAxis1(joint, 0.0, 0.0, 1.0);
      dJointSetUniversalAxis2(joint, 0.0, 1.0, 0.0);
      joints_.push_back(joint);
    }
  }

  ~Chain() {
    dJointGroupDestroy(contacts_);
    dSpaceDestroy(space_);
    dWorldDestroy(world_);
  }
  Chain(const Chain &) = delete;
  Chain &operator=(const Chain &) = delete;

  std::size_t modules() const { return count_; }
  std::size_t hinges() const { return 2 * joints_.size(); }
  double overlap_cm() const { return overlap_cm_; }

  void fold() {
    for (std::size_t i = 0; i < count_; ++i) {
      const Pose &pose = input_.folded[i];
      const double pitch = input_("pitch_cm");
      dBodySetPosition(bodies_[i], pitch * pose.position[0], pitch * pose.position[1],
                       pitch * pose.position[2]);
      dBodySetRotation(bodies_[i], pose.rotation);
    }
  }

  void set_stops(double angle_rad) {
    for (const dJointID joint : joints_)
      for (const int group : {0, static_cast<int>(dParamGroup2)}) {
        dJointSetUniversalParam(joint, dParamLoStop + group, -angle_rad);
        dJointSetUniversalParam(joint, dParamHiStop + group, angle_rad);
      }
  }

  void set_motor_torque(double torque) {
    for (const dJointID joint : joints_) {
      dJointSetUniversalParam(joint, dParamFMax, torque);
      dJointSetUniversalParam(joint, dParamFMax2, torque);
    }
  }

  // Set (J,) rates of the motors. ODE's motor rate is that of the first body against the second.
  void set_rates(const std::vector<double> &rates) {
    for (std::size_t k = 0; k < joints_.size(); ++k) {
      dJointSetUniversalParam(joints_[k], dParamVel, -rates[2 * k]);
      dJointSetUniversalParam(joints_[k], dParamVel2, -rates[2 * k + 1]);
    }
  }

  // Compute the (J,) hinge angles: R_iᵀ R_{i+1} = R_z(a) R_y(b).
  void angles(std::vector<double> &values) const {
    values.resize(hinges());
    for (std::size_t k = 0; k < joints_.size(); ++k) {
      const dReal *first = dBodyGetRotation(bodies_[k + 1]);
      const dReal *second = dBodyGetRotation(bodies_[k + 2]);
      const auto entry = [&](int row, int column) {
        return first[row] * second[column] + first[4 + row] * second[4 + column] +
               first[8 + row] * second[8 + column];
      };
      values[2 * k] = std::atan2(-entry(0, 1), entry(1, 1));
      values[2 * k + 1] = std::atan2(-entry(2, 0), entry(2, 2));
    }
  }

  void positions(std::vector<Vector> &values) const {
    values.resize(count_);
    for (std::size_t i = 0; i < count_; ++i) {
      const dReal *p = dBodyGetPosition(bodies_[i]);
      values[i] = {p[0], p[1], p[2]};
    }
  }

  void add_forces(const std::vector<Vector> &forces) {
    for (std::size_t i = 0; i < count_; ++i)
      dBodyAddForce(bodies_[i], forces[i][0], forces[i][1], forces[i][2]);
  }

  void add_springs(double stiffness, const std::vector<double> &angles) {
    for (std::size_t k = 0; k < joints_.size(); ++k)
      dJointAddUniversalTorques(joints_[k], stiffness * angles[2 * k],
                                stiffness * angles[2 * k + 1]);
  }

  void step() {
    dSpaceCollide(space_, this, &Chain::collide);
    if (iterations_ > 0)
      dWorldQuickStep(world_, step_s_);
    else
      dWorldStep(world_, step_s_);
    dJointGroupEmpty(contacts_);
  }

  // Return the largest distance by which a joint has come apart, cm.
  double joint_gap_cm() const {
    double largest = 0.0;
    for (const dJointID joint : joints_) {
      dVector3 a, b;
      dJointGetUniversalAnchor(joint, a);
      dJointGetUniversalAnchor2(joint, b);
      largest = std::max(largest, std::hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]));
    }
    return largest;
  }

 private:
  static void collide(void *data, dGeomID a, dGeomID b) {
    Chain &chain = *static_cast<Chain *>(data);
    const auto i = reinterpret_cast<std::size_t>(dGeomGetData(a));
    const auto j = reinterpret_cast<std::size_t>(dGeomGetData(b));
    if ((i > j ? i - j : j - i) < 2) return;  // linked modules overlap where their joint bends
    dContact contacts[MAX_CONTACTS_PER_PAIR] = {};
    const int count = dCollide(a, b, MAX_CONTACTS_PER_PAIR, &contacts[0].geom, sizeof(dContact));
    for (int k = 0; k < count; ++k) {
      contacts[k].surface.mode = dContactApprox1;
      contacts[k].surface.mu = chain.friction_;
      chain.overlap_cm_ = std::max(chain.overlap_cm_, double(contacts[k].geom.depth));
      const dJointID joint = dJointCreateContact(chain.world_, chain.contacts_, &contacts[k]);
      dJointAttach(joint, dGeomGetBody(a), dGeomGetBody(b));
    }
  }

  const Input &input_;
  int iterations_;
  double step_s_;
  double friction_;
  std::size_t count_;
  dWorldID world_;
  dSpaceID space_;
  dJointGroupID contacts_;
  std::vector<dBodyID> bodies_;
  std::vector<dJointID> joints_;
  double overlap_cm_ = 0.0;
};

// Figures of one of the two simulations.
struct Phase {
  std::string status;
  long steps = 0;
  double processor_s = 0.0;
  double joint_gap_cm = 0.0;
  double overlap_cm = 0.0;
};

double largest(const std::vector<double> &values) {
  double result = 0.0;
  for (const double value : values) result = std::max(result, std::abs(value));
  return result;
}

bool is_finite(const std::vector<double> &values) {
  return std::all_of(values.begin(), values.end(),
                     [](double value) { return std::isfinite(value); });
}

double span(const std::vector<Vector> &p) {
  const Vector &a = p.front(), &b = p.back();
  return std::hypot(b[0] - a[0], b[1] - a[1], b[2] - a[2]);
}

using Rows = std::vector<std::vector<double>>;

// ``record`` of Figure 2: explode the folded chain, and record its angles until it is straight.
Phase record(const Input &input, Rows &snapshots) {
  Chain chain(input, input("geom_size"), input("explosion_iterations"));
  chain.fold();
  chain.set_stops(input("stop_rad"));
  const double pitch = input("pitch_cm");
  const published::Gains gains{input("radial_gain"), pitch, input("repulsion_gain"),
                               pitch * input("repulsion_cutoff")};
  const long interval = std::lround(input("snapshot_interval"));
  const double length = pitch * static_cast<double>(chain.modules() - 1);
  std::vector<Vector> positions, forces(chain.modules());
  std::vector<double> angles;
  Phase phase{"timeout"};
  const double start_s = processor_seconds();
  for (; phase.steps < std::lround(input("max_steps")); ++phase.steps) {
    chain.angles(angles);
    chain.positions(positions);
    if (phase.steps % interval == 0) snapshots.push_back(angles);
    if (phase.steps % CHECK_STEPS == 0) {
      phase.joint_gap_cm = std::max(phase.joint_gap_cm, chain.joint_gap_cm());
      if (!is_finite(angles)) {
        phase.status = "diverged";
        break;
      }
      if (largest(angles) < STRAIGHT_RAD && span(positions) >= STRAIGHT_SPAN * length) {
        phase.status = "straight";
        snapshots.push_back(std::vector<double>(chain.hinges(), 0.0));
        break;
      }
    }
    published::explosion_forces(positions, gains, forces);
    chain.add_forces(forces);
    chain.add_springs(input("spring"), angles);
    chain.step();
  }
  phase.processor_s = processor_seconds() - start_s;
  phase.overlap_cm = chain.overlap_cm();
  return phase;
}

// Return the largest difference of two rows of angles, rad.
double difference(const std::vector<double> &a, const std::vector<double> &b) {
  double result = 0.0;
  for (std::size_t k = 0; k < a.size(); ++k) result = std::max(result, std::abs(a[k] - b[k]));
  return result;
}

// ``playback`` of Figure 2: servo to each snapshot, in reverse, until the largest squared error is
// below the threshold, and for at least ``steps_per_snapshot`` steps. Set the largest error of a
// hinge against its snapshot, rad.
Phase play_back(const Input &input, const Rows &snapshots, Rows &frames,
                double &largest_error_rad) {
  Chain chain(input, input("playback_size"), input("playback_iterations"));
  const double torque = input("motor_max_force");
  chain.set_motor_torque(torque > 0.0 ? torque : dInfinity);
  const double gain = input("motor_gain"), threshold_rad = std::sqrt(input("threshold"));
  const long least = std::max(1L, std::lround(input("steps_per_snapshot")));
  std::vector<double> angles, rates(chain.hinges());
  Phase phase{"folded"};
  const double start_s = processor_seconds();
  std::size_t next = snapshots.size() - 1;
  long waited = 0, held = 0;
  for (;; ++phase.steps, ++waited) {
    chain.angles(angles);
    double error_rad = difference(snapshots[next], angles);
    if (!is_finite(angles)) {
      phase.status = "diverged";
      break;
    }
    if (waited >= least && error_rad < threshold_rad) {
      if (next == 0 && ++held > END_STEPS) break;
      if (next > 0) {
        --next;
        waited = 0;
        error_rad = difference(snapshots[next], angles);
      }
    }
    if (waited == 0) frames.push_back(angles);
    largest_error_rad = std::max(largest_error_rad, error_rad);
    if (waited > least + MAX_WAIT_STEPS) {
      phase.status = "jammed";
      break;
    }
    if (phase.steps % CHECK_STEPS == 0)
      phase.joint_gap_cm = std::max(phase.joint_gap_cm, chain.joint_gap_cm());
    for (std::size_t k = 0; k < angles.size(); ++k)
      rates[k] = gain * (snapshots[next][k] - angles[k]);
    chain.set_rates(rates);
    chain.step();
  }
  frames.push_back(angles);
  phase.processor_s = processor_seconds() - start_s;
  phase.overlap_cm = chain.overlap_cm();
  return phase;
}

void write_rows(const char *path, const Rows &rows) {
  std::ofstream file(path, std::ios::binary);
  for (const auto &row : rows)
    file.write(reinterpret_cast<const char *>(row.data()),
               static_cast<std::streamsize>(row.size() * sizeof(double)));
  if (!file.flush()) fail(std::string("Cannot write ") + path + ".");
}

void print_phase(const char *name, const Phase &phase) {
  std::printf(
      "\"%s\": {\"status\": \"%s\", \"steps\": %ld, \"processor_s\": %.6f, "
      "\"joint_gap_cm\": %.9g, \"overlap_cm\": %.9g}, ",
      name, phase.status.c_str(), phase.steps, phase.processor_s, phase.joint_gap_cm,
      phase.overlap_cm);
}

}  // namespace

int main(int count, char **arguments) {
  if (count != 4) fail("usage: published INPUT SNAPSHOTS FRAMES");
  const Input input = read_input(arguments[1]);
  dInitODE2(0);
  dRandSetSeed(0);
  Rows snapshots, frames;
  double largest_error_rad = 0.0;
  const Phase explosion = record(input, snapshots);
  Phase playback{"none"};
  if (explosion.status == "straight")
    playback = play_back(input, snapshots, frames, largest_error_rad);
  write_rows(arguments[2], snapshots);
  write_rows(arguments[3], frames);
  std::printf("{");
  print_phase("explosion", explosion);
  print_phase("playback", playback);
  std::printf("\"max_angle_error_rad\": %.9g}\n", largest_error_rad);
  dCloseODE();
  return 0;
}
