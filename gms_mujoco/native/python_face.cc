// What Python calls through ctypes: the catalogue, and one joint built, replayed and freed.
#include <algorithm>
#include <vector>

#include "api.h"
#include "effect.h"
#include "implicit.h"
#include "joint.h"

using gms::Joint;

GMS_API int gms_n_effects() { return gms::kCatalogueSize; }

GMS_API const gms::Effect* gms_effect(int i) { return gms::kCatalogue[i]; }

GMS_API Joint* gms_joint_new() { return new Joint; }

GMS_API void gms_joint_delete(Joint* joint) { delete joint; }

// Adds effect number `effect` of the catalogue; returns 0, or -1 where the state would grow too large.
GMS_API int gms_joint_add(Joint* joint, int effect, int n, const double* p) {
  const gms::Effect* e = gms::kCatalogue[effect];
  if (joint->n_state() + (e->n_state ? e->n_state(n) : 0) > Joint::kMaxState) return -1;
  joint->add(e, n, p);
  return 0;
}

GMS_API int gms_joint_n_state(const Joint* joint) { return joint->n_state(); }
GMS_API int gms_joint_n_memory(const Joint* joint) { return joint->n_memory(); }

// Torque of the joint at n samples of a given motion, starting from `memory` (n_memory unknowns in [-1, 1];
// null: never moved). `load` and `temperature` may be null. `parts`, n x n_effects, and `states`, n x n_state,
// may be null.
GMS_API void gms_joint_replay(const Joint* joint, int n, const double* time, const double* position,
                              const double* velocity, const double* load, const double* temperature,
                              const double* memory, double* torque, double* parts, double* states) {
  const int n_state = joint->n_state(), n_parts = static_cast<int>(joint->uses().size());
  std::vector<double> state(n_state), next(n_state);
  if (memory) {
    joint->recall(memory, state.data());
  } else {
    joint->reset(state.data());
  }
  for (int k = 0; k < n; k++) {
    const gms::Sample now{time[k], position[k], velocity[k], load ? load[k] : 0,
                          temperature ? temperature[k] : 0};
    torque[k] = joint->torque(now, state.data(), next.data(), parts ? parts + k * n_parts : nullptr);
    state.swap(next);
    if (states) std::copy(state.begin(), state.end(), states + static_cast<size_t>(k) * n_state);
  }
}

// Motion of one axis of `inertia` under torque[k] held from sample k to k + 1: position, velocity, and the torque
// of the effects at each sample. Semi-implicit Euler with `substeps` per sample, as MuJoCo's Euler; the effects are
// taken explicitly at the beginning of a step or by backward Euler (`implicit` 1 or 0; -1: where the step is
// long for their stiffness). Returns the number of samples done: fewer than n where the motion ran away.
GMS_API int gms_joint_simulate(const Joint* joint, int n, int substeps, int implicit, double sample_time,
                               double inertia, double start, const double* torque, const double* load,
                               const double* temperature, const double* memory, const double* initial,
                               double* position, double* velocity, double* friction, double* states) {
  const int n_state = joint->n_state();
  std::vector<double> state(n_state), next(n_state);
  if (initial) {
    std::copy(initial, initial + n_state, state.begin());
  } else if (memory) {
    joint->recall(memory, state.data());
  } else {
    joint->reset(state.data());
  }
  const double h = sample_time / substeps, mobility = 1 / inertia;
  const double steepest = joint->slope(h);
  if (implicit < 0) implicit = h * steepest * mobility > gms::kExplicitLimit;

  const int one = 1, zero = 0;
  const gms::Tree tree{1, &one, &zero, &zero, &inertia, nullptr, nullptr};
  gms::Implicit solver;
  solver.reserve(1, 1, 1);
  double slope = -1;

  gms::Sample now{start, position[0], velocity[0]};
  for (int k = 0; k < n; k++) {
    now.load = load ? load[k] : 0;
    now.temperature = temperature ? temperature[k] : 0;
    for (int i = 0; i < substeps; i++) {
      double f = joint->torque(now, state.data(), next.data());
      state.swap(next);
      if (implicit) {
        auto& unit = solver.units[0];
        unit.joint = joint;
        unit.dof = 0;
        unit.weight = mobility;
        unit.steepest = steepest;
        unit.now = now;
        unit.state = state.data();
        unit.torque = f;
        unit.slope = slope;
        solver.solve(1, tree, nullptr, &now.velocity, &torque[k], h);
        f = unit.torque;
        slope = unit.slope;
      }
      if (i == 0) {
        position[k] = now.position;
        velocity[k] = now.velocity;
        friction[k] = f;
        if (states) std::copy(state.begin(), state.end(), states + static_cast<size_t>(k) * n_state);
        if (!std::isfinite(now.position) || !std::isfinite(f)) return k;
      }
      now.velocity += h * ((f + torque[k]) * mobility);
      now.position += h * now.velocity;
      now.time += h;
    }
  }
  return n;
}
