// Allowances: by how much errors of hinges bring two modules nearer than the motion alone.
//
// Lemmas 11 and 12 of docs/decisions/0012-sweep-bound.md.
#pragma once

#include "arrays.hpp"

namespace foldback {

// Errors of hinges that a motion must stand: those of one hinge, and those of all hinges.
struct Tolerance {
  double one_hinge_rad;   // error of any one hinge while all others are exact, at any moment
  double each_hinge_rad;  // ε, largest error of each hinge, independent of the others
  double deviations;      // κ of lemma 12: standard deviations of a sum of errors that are covered
  double spare;           // distance in pitches that must remain besides
};

// Distances of the joints between two modules a and b from points of these, in pitches.
struct Levers {
  double longest = 0.0;  // of the smaller distance, from points of a or b: lemma 11
  double total = 0.0;    // sum of the distances from points of b: lemma 12
  double squares = 0.0;  // sum of their squares
};

// Distance by which errors bring two modules nearer, in pitches; ∞ if unbounded. Between the two
// are `joints` joints of `hinges` hinges each.
double allowance(const Tolerance &tolerance, const Levers &levers, double joints, double hinges);

// Write the largest allowance of any two modules k links apart to out[k]. Neighbouring centres are
// at most `link` apart, so that the c-th joint from a module is at most c links away from its
// centre, and at most `extent`. `arm` is the farthest that any point of a module is from its
// centre, plus that of a joint from the centre of the module before it.
void write_largest_allowances(const Tolerance &tolerance, double extent, double link, double arm,
                              double hinges, View<double, 1> out);

}  // namespace foldback
