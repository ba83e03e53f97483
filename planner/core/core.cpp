// The compiled core as a Python module.
#include <nanobind/nanobind.h>

namespace foldback {
void bind_allowances(nanobind::module_ &);
void bind_backbite(nanobind::module_ &);
void bind_chain_steps(nanobind::module_ &);
void bind_clearance(nanobind::module_ &);
void bind_constrained(nanobind::module_ &);
void bind_crossings(nanobind::module_ &);
void bind_cube_turns(nanobind::module_ &);
void bind_floating_torques(nanobind::module_ &);
void bind_folded_core(nanobind::module_ &);
void bind_free_bodies(nanobind::module_ &);
void bind_joint_turns(nanobind::module_ &);
void bind_kinematics(nanobind::module_ &);
void bind_knots(nanobind::module_ &);
void bind_lattice_counts(nanobind::module_ &);
void bind_linked(nanobind::module_ &);
void bind_motion_bounds(nanobind::module_ &);
void bind_pairs(nanobind::module_ &);
void bind_path_annealing(nanobind::module_ &);
void bind_peeling_steps(nanobind::module_ &);
void bind_pictures(nanobind::module_ &);
void bind_robot_steps(nanobind::module_ &);
void bind_segment_state(nanobind::module_ &);
void bind_servo_step(nanobind::module_ &);
void bind_smoothing(nanobind::module_ &);
void bind_snake_cubes(nanobind::module_ &);
void bind_speed_profiles(nanobind::module_ &);
void bind_statics(nanobind::module_ &);
void bind_step_control(nanobind::module_ &);
void bind_sweep(nanobind::module_ &);
void bind_tetrahedron_turns(nanobind::module_ &);
void bind_trails(nanobind::module_ &);
void bind_window_distances(nanobind::module_ &);
void bind_window_forces(nanobind::module_ &);
void bind_window_steps(nanobind::module_ &);
}  // namespace foldback

NB_MODULE(_core, m) {
  m.doc() = "Compiled loops over arrays and named tuples of arrays.";
  foldback::bind_allowances(m);
  foldback::bind_backbite(m);
  foldback::bind_chain_steps(m);
  foldback::bind_clearance(m);
  foldback::bind_constrained(m);
  foldback::bind_crossings(m);
  foldback::bind_cube_turns(m);
  foldback::bind_floating_torques(m);
  foldback::bind_folded_core(m);
  foldback::bind_free_bodies(m);
  foldback::bind_joint_turns(m);
  foldback::bind_kinematics(m);
  foldback::bind_knots(m);
  foldback::bind_lattice_counts(m);
  foldback::bind_linked(m);
  foldback::bind_motion_bounds(m);
  foldback::bind_pairs(m);
  foldback::bind_path_annealing(m);
  foldback::bind_peeling_steps(m);
  foldback::bind_pictures(m);
  foldback::bind_robot_steps(m);
  foldback::bind_segment_state(m);
  foldback::bind_servo_step(m);
  foldback::bind_smoothing(m);
  foldback::bind_snake_cubes(m);
  foldback::bind_speed_profiles(m);
  foldback::bind_statics(m);
  foldback::bind_step_control(m);
  foldback::bind_sweep(m);
  foldback::bind_tetrahedron_turns(m);
  foldback::bind_trails(m);
  foldback::bind_window_distances(m);
  foldback::bind_window_forces(m);
  foldback::bind_window_steps(m);
}
