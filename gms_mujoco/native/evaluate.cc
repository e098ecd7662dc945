#include "evaluate.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>

namespace gms {

namespace {

constexpr double kLoose = 0.3;   // h slope / inertia up to which what others do to a joint may be that of the last step
constexpr double kLasting = 0.95;  // weight of what constraints did a step ago, beside what they do now
constexpr double kStill = 1e-9;  // of what a joint would move under the whole jump of its law: within rounding of rest

// Equal to the last bit: what follows from the same numbers is the same, and need not be worked out again.
inline bool same(double a, double b) {
  std::uint64_t x, y;
  std::memcpy(&x, &a, sizeof x);
  std::memcpy(&y, &b, sizeof y);
  return x == y;
}

// Automatic: implicit where an explicit step may be unstable. It is stable where (w h)^2 + 2 h sigma / J < 4; half of
// that is left for the coupling between joints, and below it the explicit step is the more accurate one.
GMS_SELDOM void choose_integration(const mjModel* m, Group* g, Instance* instance) {
  Plan plan = *instance->plan;
  for (Unit& x : plan.units) {
    g->n_late -= x.late();
    x.timestep = m->opt.timestep;
    x.weight = m->dof_invweight0[x.dof];
    x.slope = x.joint->slope(x.timestep);
    x.stiffness = x.timestep * x.slope * x.weight;
    x.implicit = x.integration == kForcedImplicit || (x.integration == kAuto && x.stiffness > kExplicitLimit);
    g->n_late += x.late();
  }
  instance->plan = in_common(std::move(plan));
}

// The first sample, as a replay takes it: each effect learns the velocity that it sets out with.
void set_out(const Unit& x, mjData* d) {
  double *state = x.state(d), first[Joint::kMaxState];
  state[0] = state[1] = std::nan("");
  x.joint->torque(x.now(d), state, first);
  std::copy(first, first + x.n_state, state);
}

// Torque of a late joint over a step with the acceleration that stands in qacc: what mj_inverse asks for. It calls
// us with the passive forces and never again, as mj_forward does, which will put another torque in this place.
double torque_of_acceleration(const mjModel* m, const mjData* d, const Unit& x, const double* state, double last) {
  const Sample now = x.now(d);
  const double h = m->opt.timestep, v = now.velocity + h * d->qacc[x.dof];
  const double still = std::isnan(state[0]) ? 0 : (state[0] - now.position) / h;
  const double forward = x.joint->torque_ahead(now, state, h, still, 1);
  const double backward = x.joint->torque_ahead(now, state, h, still, -1);
  if (std::fabs(v - still) <= kStill * h * x.weight * (backward - forward)) {  // holds, with any torque in between
    return std::min(std::max(last, forward), backward);
  }
  return x.joint->torque_ahead(now, state, h, v, v > still ? 1 : -1);
}

// The torque to begin with where the last advance has not left just this.
GMS_SELDOM double look(const mjModel* m, mjData* d, const Unit& x) {
  double *state = x.state(d), *book = x.book(d);
  // Setting a position after a reset, or turning time back, is no motion.
  if (d->time < state[1]) book[kAheadVelocity] = kLargest;
  if (book[kAheadVelocity] >= kLargest && !(d->time > state[1])) set_out(x, d);
  if (!x.late()) return x.joint->torque(x.now(d), state, nullptr);
  if (d->time > state[1]) return book[kTorque];  // a stage of RK4 keeps the torque of the first
  return torque_of_acceleration(m, d, x, state, book[kTorque]);
}

// Torque of the actuators on each dof, from the forces they have now; null where MuJoCo has to do more than clamp
// and sum, or where another plug-in may not have given its force yet.
const double* actuator_torque(const mjModel* m, const mjData* d, Group* g) {
  double* torque = g->actuator.data();
  std::fill(torque, torque + m->nv, 0.0);
  for (int i = 0; i < m->nactuator; i++) {
    if (m->actuator_biastype[i] == mjBIAS_DCMOTOR || m->actuator_outnum[i] != 1) return nullptr;
    if (m->actuator_plugin[i] >= 0) return nullptr;
    if (m->actuator_trntype[i] == mjTRN_TENDON && m->tendon_actfrclimited[m->actuator_trnid[2 * i]]) return nullptr;
    const int out = m->actuator_outadr[i], start = d->moment_rowadr[out];
    double force = d->actuator_force[out];
    if (force == 0) continue;
    if (m->actuator_forcelimited[i]) {
      force = std::min(std::max(force, m->actuator_forcerange[2 * i]), m->actuator_forcerange[2 * i + 1]);
    }
    for (int k = 0; k < d->moment_rownnz[out]; k++) {
      torque[d->moment_colind[start + k]] += d->actuator_moment[start + k] * force;
    }
  }
  const double* gravity = m->opt.gravity;
  const bool compensated = m->flg_gravcomp && !(m->opt.disableflags & mjDSBL_GRAVITY) &&
                           (gravity[0] != 0 || gravity[1] != 0 || gravity[2] != 0);
  for (int i = 0; compensated && i < m->njnt; i++) {
    if (!m->jnt_actgravcomp[i]) continue;
    const int dof = m->jnt_dofadr[i];
    const int size = m->jnt_type[i] == mjJNT_FREE ? 6 : m->jnt_type[i] == mjJNT_BALL ? 3 : 1;
    for (int k = dof; k < dof + size; k++) torque[k] += d->qfrc_gravcomp[k];
  }
  for (int i = 0; i < m->njnt; i++) {
    if (!m->jnt_actfrclimited[i]) continue;
    double& t = torque[m->jnt_dofadr[i]];
    t = std::min(std::max(t, m->jnt_actfrcrange[2 * i]), m->jnt_actfrcrange[2 * i + 1]);
  }
  return torque;
}

bool any_wrench(const mjModel* m, const mjData* d) {
  std::uint64_t any = 0, bits;
  for (int i = 1; i < m->nbody; i++) {
    for (int k = 0; k < 6; k++) {
      std::memcpy(&bits, d->xfrc_applied + 6 * i + k, sizeof bits);
      any |= bits;
    }
  }
  return any != 0;
}

// Adds the wrenches that act on bodies.
GMS_APART void add_wrenches(const mjModel* m, const mjData* d, double* tau) {
  for (int i = 1; i < m->nbody; i++) {
    const double* w = d->xfrc_applied + 6 * i;
    if (w[0] != 0 || w[1] != 0 || w[2] != 0 || w[3] != 0 || w[4] != 0 || w[5] != 0) {
      engine.mj_applyFT(m, const_cast<mjData*>(d), w, w + 3, d->xipos + 3 * i, i, tau);
    }
  }
}

// MuJoCo damps a joint implicitly, except under RK4: torque -D v+ where qfrc_passive has -D v. Null where none is damped.
const double* implicit_damping(const mjModel* m) {
  if (m->opt.integrator == mjINT_RK4 || m->opt.disableflags & mjDSBL_DAMPER) return nullptr;
  if (m->opt.integrator == mjINT_EULER && m->opt.disableflags & mjDSBL_EULERDAMP) return nullptr;
  for (int i = 0; i < m->nv; i++) {
    if (m->dof_damping[i] != 0) return m->dof_damping;
  }
  return nullptr;
}

// What hangs on a joint by a constraint has to be moved with it: A dv / h more, as if by a damper, where the constraint
// would go on as it did with the acceleration of the last step. What is far from stiff may do without.
GMS_SELDOM const double* with_burdens(const mjModel* m, const mjData* d, Group* g, int count, const double* damping) {
  double* out = g->damping.data();
  for (int i = 0; i < m->nv; i++) out[i] = damping ? damping[i] : 0;
  for (int i = 0; i < count; i++) {
    const Active& a = g->active[i];
    const double *book = a.unit->book(d), burden = book[kBurden];
    out[a.unit->dof] += burden / m->opt.timestep;
    a.late->assumed += burden * book[kPastAcceleration];
    a.late->own += burden * book[kPastAcceleration];
  }
  return out;
}

// Puts the torque of a late joint over the step into qfrc_passive, in the place of the last one. Adding the difference
// would be wrong by a rounding error each time.
inline void finish(const Active& a, mjData* d, double f, double slope) {
  double* book = a.unit->book(d);
  book[kTorque] = f;
  a.late->slope = slope;
  a.unit->passive(d) = a.late->sum = a.late->base + f;
  a.late->own += f;
}

// Late joints that are far from stiff, where none is damped: each for itself. What the others do to it is that of the last
// step, and M is not even solved with: their friction at the end of the last step is their friction at the beginning of
// this one.
inline Alone loose(const mjModel* m, const mjData* d, const Active& a) {
  const Unit& x = *a.unit;
  const double *state = x.state(d), *book = x.book(d), start = book[kAhead];
  const double h = m->opt.timestep;
  const Sample now = x.now(d);
  const double still = std::isnan(state[0]) ? 0 : (state[0] - now.position) / h;
  const double free = now.velocity + h * (book[kFromOthers] + x.weight * (a.late->own + start));
  return {now, still, free, h * x.weight, start, x.slope, free};
}

GMS_APART void solve_loose(const mjModel* m, mjData* d, const Active* active, int count) {
  Together t;
  Alone alone[kTogether];
  for (int i = 0, n; i < count; i += n) {
    const Joint& joint = *active[i].unit->joint;
    const int most = std::min(joint.at_once(), count - i);
    for (n = 0; n < most && active[i + n].unit->joint->alike(joint); n++) {
      const Unit& x = *active[i + n].unit;
      alone[n] = loose(m, d, active[i + n]);
      t.joint[n] = x.joint;
      t.state[n] = x.state(d);
      t.motion[n] = alone[n].ahead(t.state[n], m->opt.timestep);
    }
    solve_alone(n, alone, m->opt.timestep, &t);
    for (int j = 0; j < n; j++) finish(active[i + j], d, t.torque[j], -1);
  }
}

// The others: see Implicit.
GMS_APART void solve_implicit(const mjModel* m, mjData* d, Group* g, int count, const double* damping) {
  Implicit::Unit few[kFew], *units = count <= kFew ? few : g->many.data();
  for (int i = 0; i < count; i++) {
    const Unit& x = *g->active[i].unit;
    const double* book = x.book(d);
    auto& u = units[i];
    u.joint = x.joint;
    u.dof = x.dof;
    u.weight = x.weight;
    u.steepest = x.slope;
    u.now = x.now(d);
    u.state = x.state(d);
    u.torque = book[kAhead];
    u.slope = book[kSlope] >= kLargest ? kInfinity : book[kSlope];
  }
  const Inertia inertia{{static_cast<int>(m->nv), m->M_rownnz, m->M_rowadr, m->M_colind}, d->M, d->qLD, d->qLDiagInv};
  g->implicit.units = units;
  g->implicit.solve(count, inertia, damping, d->qvel, g->tau.data(), m->opt.timestep);
  for (int i = 0; i < count; i++) {
    finish(g->active[i], d, units[i].torque, units[i].slope);
  }
}

// Torque of all late joints, from `bias` (qfrc_bias) and `actuator` (qfrc_actuator).
void evaluate_late(const mjModel* m, mjData* d, Group* g, const double* bias, const double* actuator) {
  int n = 0;
  bool all_loose = true, burdened = false;
  for (Instance* instance : g->instances) {
    const Unit *first = instance->units().data(), *end = first + instance->units().size();
    Late* late = instance->late.data();
    for (const Unit* unit = first; unit < end; unit++, late++) {
      const Unit& x = *unit;
      if (!x.late() || x.asleep(d)) continue;
      if (d->time > x.state(d)[1]) continue;  // a stage of RK4 keeps the torque of the first
      const double now = x.passive(d);
      if (now != late->sum) {  // another has added to it since we wrote: that stays
        late->base += now - late->sum;
        late->sum = now;
      }
      const double* book = x.book(d);
      late->assumed = book[kConstraint];
      late->own = late->base - bias[x.dof] + d->qfrc_applied[x.dof] + actuator[x.dof] + late->assumed;
      burdened |= book[kBurden] > 0;
      all_loose &= x.stiffness <= kLoose && book[kFromOthers] < kLargest;
      g->active[n++] = {&x, late};
    }
  }
  if (n == 0) return;

  const Active* active = g->active.data();
  const double* damping = implicit_damping(m);
  const bool wrenches = any_wrench(m, d);
  all_loose &= !damping;
  if (burdened && !all_loose) damping = with_burdens(m, d, g, n, damping);
  if (wrenches || !all_loose) {
    double* tau = g->tau.data();
    for (int i = 0; i < m->nv; i++) tau[i] = d->qfrc_passive[i] - bias[i] + d->qfrc_applied[i] + actuator[i];
    for (int i = 0; i < n; i++) tau[active[i].unit->dof] = active[i].late->own;
    if (wrenches) add_wrenches(m, d, tau);
    for (int i = 0; i < n; i++) active[i].late->own = tau[active[i].unit->dof];
  }
  if (!all_loose) {
    solve_implicit(m, d, g, n, damping);
  } else if (n > 1) {
    solve_loose(m, d, active, n);
  } else {
    const Unit& x = *active[0].unit;
    finish(active[0], d, loose(m, d, active[0]).torque(*x.joint, x.state(d), m->opt.timestep, kLooks), -1);
  }
}

// Whether MuJoCo calls us again in this step, among the actuators or at the control callback.
bool called_later(const mjModel* m) {
  return !(m->opt.disableflags & mjDSBL_ACTUATION) && (m->nactuator > 0 || *engine.mjcb_control == gms_control);
}

void compute_unactuated(const mjModel* m, mjData* d, Group* g, const double* bias) {
  std::fill(g->actuator.begin(), g->actuator.end(), 0.0);
  evaluate_late(m, d, g, bias, g->actuator.data());
}

// The late joints of a model in which nothing calls us after the passive forces.
GMS_SELDOM void take_now(const mjModel* m, mjData* d, Group* g) {
  double* bias = g->bias.data();
  std::fill(bias, bias + m->nv, 0.0);
  engine.mj_rne(m, d, 0, bias);
  compute_unactuated(m, d, g, bias);
}

inline void take_unless_later(const mjModel* m, mjData* d, Group* g, const Instance* instance) {
  if (g->n_late > 0 && instance == g->instances.back() && !called_later(m)) take_now(m, d, g);
}

inline bool chosen(const mjModel* m, const Unit& x) {
  return same(x.timestep, m->opt.timestep) && same(x.weight, m->dof_invweight0[x.dof]);
}

// Whether the last advance has evaluated just this, as it has as a rule, and nobody has asked for another acceleration.
inline bool known(const mjData* d, const Unit& x) {
  const double *state = x.state(d), *book = x.book(d);
  return same(d->time, state[1]) && same(d->qpos[x.place], state[0]) && same(d->qvel[x.dof], book[kAheadVelocity]) &&
         (!x.late() || same(d->qacc[x.dof], book[kPastAcceleration]));
}

// Then a late joint begins with the torque that it had.
inline double known_torque(const mjData* d, const Unit& x) { return x.book(d)[x.late() ? kTorque : kAhead]; }

inline void give(mjData* d, const Unit& x, Late* late, double f) {
  x.book(d)[kTorque] = f;
  double& passive = x.passive(d);
  if (x.late()) {
    late->base = passive;
    late->sum = passive + f;
  }
  passive += f;
}

// From joint number i of an instance on.
GMS_SELDOM void look_from(const mjModel* m, mjData* d, Group* g, Instance* instance, size_t i) {
  for (; i < instance->units().size(); i++) {
    if (!chosen(m, instance->units()[i])) choose_integration(m, g, instance);
    const Unit& x = instance->units()[i];
    if (!x.asleep(d)) give(d, x, &instance->late[i], known(d, x) ? known_torque(d, x) : look(m, d, x));
  }
  take_unless_later(m, d, g, instance);
}

// Constraints are solved after friction, which has to know what they will do: what they did in the last step, less an
// inertia A times what the acceleration changes by. A is the slope of the one on the other in the steps so far, of which
// each counts kLasting times as much as the next: with A = 0 what a light joint holds by a constraint would slip out of
// it, and after one step alone joints that share a contact would not come to rest.
inline void note_constraint(double* book, double torque, double acceleration) {
  if (torque == 0) {
    book[kBurden] = book[kFounded] = 0;
  } else {
    const double change = acceleration - book[kPastAcceleration], before = kLasting * book[kFounded];
    book[kFounded] = before + change * change;
    if (book[kFounded] > 0) {
      const double slope = (before * book[kBurden] + (book[kConstraint] - torque) * change) / book[kFounded];
      book[kBurden] = std::fmax(slope, 0);
    }
  }
  book[kConstraint] = torque;
}

// The step is over. Notes where the joint is now, and says how it has moved.
inline Motion arrive(const mjModel* m, const mjData* d, const Unit& x, const Late& late) {
  double *state = x.state(d), *book = x.book(d);
  if (x.load >= 0) {  // what the drive gives, less what friction and the rotor take
    const double drive = (m->nactuator > 0 ? d->qfrc_actuator : d->qfrc_applied)[x.dof];
    book[x.load] = drive + book[kTorque] + d->qfrc_damper[x.dof] - m->dof_armature[x.dof] * d->qacc[x.dof];
  }
  book[kAheadVelocity] = d->qvel[x.dof];
  if (x.late()) {
    const double constraint = d->qfrc_constraint[x.dof];
    note_constraint(book, constraint, d->qacc[x.dof]);
    book[kPastAcceleration] = d->qacc[x.dof];
    book[kFromOthers] = d->qacc[x.dof] - x.weight * (late.own - late.assumed + constraint);
    book[kSlope] = std::min(late.slope, kLargest);
  }
  return Joint::since(x.now(d), state);
}

// A joint that sleeps is where it was, whatever the time.
void sleep(const mjData* d, const Unit& x) {
  double* state = x.state(d);
  if (!std::isnan(state[1])) state[1] = d->time;
}

GMS_APART void advance_all(const mjModel* m, mjData* d, Instance* instance) {
  Together t;
  const Unit *x = instance->units().data(), *end = x + instance->units().size();
  const Late* late = instance->late.data();
  while (x < end) {
    const Unit* from[kTogether];
    const Joint& joint = *x->joint;
    int n = 0;
    for (; x < end && n < joint.at_once() && x->joint->alike(joint); x++, late++) {
      if (x->asleep(d)) {
        sleep(d, *x);
        continue;
      }
      from[n] = x;
      t.joint[n] = x->joint;
      t.state[n] = x->state(d);
      t.motion[n++] = arrive(m, d, *x, *late);
    }
    if (n > 0) Joint::torques(n, t.joint, t.motion, t.state, t.state, t.torque);
    for (int j = 0; j < n; j++) from[j]->book(d)[kAhead] = t.torque[j];
  }
}

}  // namespace

// Short, and without a call but at its end: most steps of most models take no more.
GMS_APART void compute_passive(const mjModel* m, mjData* d, Group* g, Instance* instance) {
  const Unit *first = instance->units().data(), *end = first + instance->units().size();
  Late* late = instance->late.data();
  for (const Unit* x = first; x < end; x++, late++) {
    if (!chosen(m, *x)) return look_from(m, d, g, instance, x - first);
    if (x->asleep(d)) continue;
    if (!known(d, *x)) return look_from(m, d, g, instance, x - first);
    give(d, *x, late, known_torque(d, *x));
  }
  take_unless_later(m, d, g, instance);
}

GMS_APART void compute_late(const mjModel* m, mjData* d, Group* g) {
  const double* torque = actuator_torque(m, d, g);
  if (!torque) {  // MuJoCo goes on from the forces as they are now, once we return
    std::copy(d->actuator_force, d->actuator_force + m->nout, g->force.begin());
    g->inside = true;
    engine.mj_fwdActuation(m, d);
    g->inside = false;
    std::copy(g->force.begin(), g->force.end(), d->actuator_force);
    torque = d->qfrc_actuator;
  }
  evaluate_late(m, d, g, d->qfrc_bias, torque);
}

void compute_at_control(const mjModel* m, mjData* d, Group* g) { compute_unactuated(m, d, g, d->qfrc_bias); }

void advance(const mjModel* m, mjData* d, Instance* instance) {
  if (instance->units().size() != 1) return advance_all(m, d, instance);
  const Unit& x = instance->units()[0];
  if (x.asleep(d)) return sleep(d, x);
  double* state = x.state(d);
  x.book(d)[kAhead] = x.joint->torque_over(arrive(m, d, x, instance->late[0]), state, state);
}

}  // namespace gms
