// Forces of soft contacts without friction on a chain.
//
// The model is MuJoCo's (its documentation, "Computation", "Constraint model"). With J the rows of
// the contact normals and M the chain's mass matrix, the forces f solve the linear complementarity
// problem
//
//     f ≥ 0,   A f + R f + b ≥ 0,   fᵀ (A f + R f + b) = 0,
//
// A = J M⁻¹ Jᵀ being the Delassus operator, R a diagonal regularisation, and b = J a − a_ref the
// accelerations at which the contacts part without forces, minus those that they should have.
// Products with M⁻¹ follow from the articulated-body quantities of `articulated.hpp`.
#pragma once

#include <vector>

#include "articulated.hpp"

namespace foldback {

// Maximum number of pivots with which the linear complementarity problem of the contact forces is
// solved exactly; beyond it the slower, approximate gradient solver takes over.
constexpr int MAX_PIVOTS = 100;
// Number of block pivots in a row that do not reduce the number of infeasible contact forces before
// the solver changes to single pivots, which cannot cycle: p̄ in Júdice & Pires (1994).
constexpr int MAX_NON_IMPROVING_PIVOTS = 3;
// Magnitude up to which a negative contact acceleration counts as zero in the pivoting solver, as a
// fraction of the largest bias. With smaller values rounding errors cause endless pivots.
constexpr double PIVOT_TOLERANCE = 1e-10;
// Number of power iterations that estimate the largest eigenvalue of the contact problem, which
// limits the step of its gradient solver.
constexpr int POWER_STEPS = 12;
// Safety factor on the largest eigenvalue of the contact problem, as power iteration finds it from
// below. With smaller values gradient steps may diverge.
constexpr double EIGENVALUE_MARGIN = 1.3;
// Maximum number of iterations of the gradient solver for contact forces; beyond it the forces
// found so far are used.
constexpr int MAX_GRADIENT_STEPS = 400;
// Residual at which the gradient solver for contact forces ends, as a fraction of the largest bias.
constexpr double GRADIENT_TOLERANCE = 1e-3;
// Minimum of the diagonal R that is added to the matrix A of the contact problem, in 1 / module
// mass. Without it A may be singular.
constexpr double MIN_REGULARISATION = 1e-15;

// m contact points between modules: the normal points to the second module of a pair.
struct PairContacts {
  View<const Index, 2> pairs;
  View<const double, 2> normals, points;
  View<const double, 1> depths;
  Index size() const { return depths.size(); }
};

// Stiffness of all contacts, in MuJoCo's parameters.
struct ContactModel {
  double time_constant, damping_ratio;
  View<const double, 1> solimp;
  Index max_direct;  // largest number of contacts whose forces are solved exactly
};

// Contacts that a collision has found.
struct Contacts {
  PairContacts points;
  ContactModel model;
};

// What contacts need to know of a chain: K hinges a joint.
struct ContactChain {
  Index rigid_links, root, hinges;
  View<const double, 2> positions;
  View<const Vector<double>, 1> velocities, angular_velocities;
  ArticulatedBodies<double> bodies;
  double inverse_root_inertia[36];
};

// What contacts need to know of a chain, after its articulated-body pass.
ContactChain contact_chain(const ChainModel &model, const ModuleStates &modules,
                           const ArticulatedBodies<double> &bodies);

// Add the effect of contacts to accelerations without contacts: exactly, or approximately where
// there are too many or no exact solution was found.
void add_contacts(const PairContacts &contacts, const ContactModel &model,
                  const ContactChain &chain, const Accelerations<double> &out);

// Write the f ≥ 0 with A f + b ≥ 0 and fᵀ (A f + b) = 0, A being (m, m), symmetric and positive
// definite, by block principal pivoting. Returns false if MAX_PIVOTS were not enough.
bool solve_complementarity(const std::vector<double> &A, const std::vector<double> &b,
                           std::vector<double> &f);

}  // namespace foldback
