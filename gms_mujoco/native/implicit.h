// Backward Euler for friction of joints that are coupled through a mass matrix.
#ifndef GMS_MUJOCO_NATIVE_IMPLICIT_H_
#define GMS_MUJOCO_NATIVE_IMPLICIT_H_

#include <algorithm>
#include <vector>

#include "joint.h"
#include "tree.h"

namespace gms {

// The inertia of a mechanism, and where it has been factored already its factor and 1 / D; else null.
struct Inertia : Tree {
  const double* value;
  const double *factor, *inverse_diagonal;
};

constexpr double kLeft = 0.05;  // error that may be left, in parts of the change of torque over the step
constexpr int kLooks = 4;       // at the law of a joint that is solved for alone

// A joint that is solved for alone: v = free + gain (f(v) - start).
struct Alone {
  Sample now;
  double still;            // velocity of no displacement since the anchor
  double free, gain;       // velocity at the end of the step with the torque `start`; its change with torque
  double start, steepest;  // torque at the anchor; Joint::slope
  double at;               // where the law is looked at: to begin with, `free`

  // Where that takes the joint over a step h from `state`.
  Motion ahead(const double* state, double h) const {
    return Joint::ahead(now, state, h, at, at > still ? 1 : at < still ? -1 : sign(now.velocity));
  }

  // Whether the torque found there may stay. If not, `at` is where to look next.
  bool settled(double torque) {
    const double change = torque - start, off = free + gain * change - at, away = at - still;
    // Away from where the joint comes from more and more of it slips: the law is steeper nowhere than its chord.
    const double chord = std::max(0.0, away == 0 ? 0 : -change / away);
    const bool onward = away * (now.velocity - still) > 0;
    if (std::fabs(off) * (onward ? chord : steepest) <= kLeft * std::fabs(change)) return true;
    at += off / (1 + gain * chord);
    return false;
  }

  // The torque over the step, after so many looks at most.
  GMS_MERGED double torque(const Joint& joint, const double* state, double h, int looks) {
    double found, next[Joint::kMaxState];
    do {
      found = joint.torque_over(ahead(state, h), state, next);
    } while (!settled(found) && --looks > 0);
    return found;
  }
};

// Solves for so many joints that are alike, t->joint, each alone, over a step h, from t->state; into t->torque. t->motion is
// where they are looked at first.
void solve_alone(int count, Alone* alone, double h, Together* t);

// Finds the torques f that solve, for all joints together,
//   (M + h D) dv = h (tau + f),  f_i in f_i(q_i + h (v_i + dv_i), v_i + dv_i).
//
// Where friction is stiff, by semismooth Newton: every joint's law is replaced by its tangent, which adds its slope to
// the diagonal of M and leaves the sparsity of the tree; one factorization and one solution give the velocities; a
// law that is not on its tangent there gets a new one. A law that jumps where the direction changes holds the joint
// while the torque that this takes lies inside the jump. In most steps the tangents of the last step are still right:
// then a joint costs one evaluation of its law. Where Newton does not settle, Gauss-Seidel with a bracketed search per
// joint does.
//
// Where no joint is stiff (h slope / inertia < 1), each is solved for alone, the others having the torque they began
// the step with: the coupling of the changes is then as explicit as all the rest of the step, and M is not factored.
class Implicit {
 public:
  struct Unit {
    const Joint* joint;
    int dof;
    double weight;        // inverse inertia at the joint, roughly
    double steepest;      // Joint::slope
    Sample now;
    double* state;        // the joint's, at the anchor
    double torque;        // in: at the anchor; out: over the step
    double slope;         // in and out: tangent of the law, -df/dv; infinite where it holds; below 0: not known

    // Of the solution; joints that are not stiff use the first alone.
    double still, start, origin;        // velocity of no displacement; torque at the anchor; point of the tangent
    double side, value;                 // side of standstill that the tangent is for; its torque at `origin`
    double used;                        // slope of the tangent in use: 0 where little depends on it
    double bend;                        // size of the law's slope there, or 0
    double factored;                    // the slope that the factor has
    double seen, off, law;              // where the law was looked at last, how far off its tangent it was, and itself
    double forward, backward;           // torque at the onset of motion either way; NaN: not looked at
  };

  Unit* units = nullptr;  // the caller's

  // For so many units, and a matrix of n rows with n_value numbers.
  void reserve(int n_units, int n, int n_value);

  // The first `count` units. `damping` (n), null where none is damped, and `velocity` (n); `tau` (n) is the net torque
  // without that of the units.
  void solve(int count, const Inertia& inertia, const double* damping, const double* velocity, const double* tau, double h);

 private:
  bool settled(Unit* unit, double velocity, double now, double reaction, double h) const;
  void tangent(Unit* unit, double at, double h) const;
  void hold_or_start(Unit* unit, double side, double h) const;
  void each_alone(int count, const double* damping, const double* dv, double h);
  void refresh(int count, const Inertia& inertia, const double* damping, double h, bool anew);
  void update(const Tree& tree, int k, double by);
  void sweep(int count, const Inertia& inertia, const double* damping, const double* velocity, const double* tau, double h);

  std::vector<double> factor_, diagonal_, path_, change_, product_, response_, free_, push_, solved_;
  std::vector<Joint::Search> search_;
  double stiffest_;        // the largest h slope / inertia
};

}  // namespace gms

#endif  // GMS_MUJOCO_NATIVE_IMPLICIT_H_
