#include "implicit.h"

#include <algorithm>

namespace gms {

namespace {

constexpr double kHold = 1e30;      // on the diagonal: the velocity of this joint is prescribed
constexpr double kExact = 1e-7;     // a law this close to its tangent is on it, in parts of the torque
constexpr double kSoft = 0.05;      // h slope / inertia below which a tangent may be taken as level
constexpr double kFine = 1e-3;      // how far a stiff neighbour may be put off, in parts of the torque
constexpr double kStiff = 1;        // h slope / inertia from which joints are solved for together
constexpr int kIterations = 12;

void multiply(const Inertia& tree, const double* x, double* y) {
  std::fill(y, y + tree.n, 0.0);
  for (int i = 0; i < tree.n; i++) {
    const double* row = tree.value + tree.row_start[i];
    const int *column = tree.column + tree.row_start[i], last = tree.row_size[i] - 1;
    for (int k = 0; k < last; k++) {
      y[i] += row[k] * x[column[k]];
      y[column[k]] += row[k] * x[i];
    }
    y[i] += row[last] * x[i];
  }
}

}  // namespace

void Implicit::reserve(int n_units, int n, int n_value) {
  factor_.resize(n_value);
  for (std::vector<double>* v : {&diagonal_, &path_, &change_, &product_}) v->resize(n);
  for (std::vector<double>* v : {&free_, &push_, &solved_}) v->resize(n_units);
  response_.resize(n_units * n_units);
  search_.resize(n_units);
}

// The factor of M + by e_k e_k', which changes along the path from k to the root alone (Gill, Golub, Murray and Saunders,
// Math. Comp. 28 (1974), method C1, from the last row up).
void Implicit::update(const Tree& tree, int k, double by) {
  const int *path = tree.column + tree.row_start[k], last = tree.row_size[k] - 1;
  double* w = path_.data();
  for (int i = 0; i < last; i++) w[path[i]] = 0;
  w[k] = 1;
  for (int i = last; i >= 0; i--) {
    const int j = path[i], above = tree.row_size[j] - 1;
    const double p = w[j], old = 1 / diagonal_[j], now = old + by * p * p, part = by * p / now;
    by *= old / now;
    diagonal_[j] = 1 / now;
    double* row = factor_.data() + tree.row_start[j];
    for (int c = 0; c < above; c++) {
      w[path[c]] -= p * row[c];
      row[c] += part * w[path[c]];
    }
  }
}

// Brings the factor of M + h (D + slopes) up to date: by its changes where they are few, else anew.
void Implicit::refresh(int count, const Inertia& inertia, const double* damping, double h, bool anew) {
  int changes = 0;
  for (int i = 0; i < count; i++) {
    const Unit& u = units[i];
    changes += u.used != u.factored;
    anew |= u.used != u.factored && (u.used == kInfinity || u.factored == kInfinity);
  }
  anew |= 2 * changes > count;
  if (anew) {
    std::copy(inertia.value, inertia.value + factor_.size(), factor_.begin());
    for (int i = 0; damping && i < inertia.n; i++) {
      factor_[inertia.diagonal(i)] += h * damping[i];
    }
  }
  for (int i = 0; i < count; i++) {
    Unit& u = units[i];
    if (anew) {
      double* diagonal = &factor_[inertia.diagonal(u.dof)];
      *diagonal = u.used == kInfinity ? kHold * *diagonal : *diagonal + h * u.used;
    } else if (u.used != u.factored) {
      update(inertia, u.dof, h * (u.used - u.factored));
    }
    u.factored = u.used;
  }
  if (anew) factor(inertia, factor_.data(), diagonal_.data());
}

// The tangent of the law at a velocity, seen from the side of it that lies further from standstill.
void Implicit::tangent(Unit* u, double at, double h) const {
  const double side = at == u->still ? u->side : at > u->still ? 1 : -1;
  const double size = std::fabs(at - u->still), small = size > 0 ? 1e-4 * size : 1e-9 / h;
  u->side = side;
  u->origin = at;
  u->value = u->joint->torque_ahead(u->now, u->state, h, at, side);
  const double beyond = u->joint->torque_ahead(u->now, u->state, h, at + side * small, side);
  const double slope = (u->value - beyond) * side / small;
  u->used = u->slope = std::max(0.0, slope);
  u->bend = std::fabs(slope);
  u->seen = at;
  u->off = 0;
  u->law = u->value;
}

// The motion has come to standstill or starts from there: where the law jumps it holds for now, else its tangent at
// standstill on this side is where Newton converges from.
void Implicit::hold_or_start(Unit* u, double side, double h) const {
  u->forward = u->joint->torque_ahead(u->now, u->state, h, u->still, 1);
  u->backward = u->joint->torque_ahead(u->now, u->state, h, u->still, -1);
  u->side = side;
  if (u->backward - u->forward > kExact * (std::fabs(u->backward) + std::fabs(u->forward))) {
    u->used = u->slope = kInfinity;
  } else {
    tangent(u, u->still, h);
  }
}

// Looks at the law where the tangents led, and puts right what is not right. Returns whether all was.
bool Implicit::settled(Unit* u, double velocity, double now, double reaction, double h) const {
  if (u->slope == kInfinity) {
    if (std::isnan(u->forward)) {
      u->forward = u->joint->torque_ahead(u->now, u->state, h, u->still, 1);
      u->backward = u->joint->torque_ahead(u->now, u->state, h, u->still, -1);
    }
    u->torque = reaction;
    if (reaction >= u->forward && reaction <= u->backward) return true;
    u->side = reaction < u->forward ? 1 : -1;
    tangent(u, u->still, h);
    return false;
  }
  const double side = velocity > u->still ? 1 : velocity < u->still ? -1 : u->side;
  u->torque = u->value - u->used * (velocity - u->origin);
  // Acting in place of its tangent, f changes the velocity, and the law is off by what it changes over that. The
  // step itself errs by about half the change of torque over it; much less than that is good enough. On the side
  // that the joint comes from more and more of it slips, so that the slope known there bounds those to come; unless
  // there is a load to run into. A stiff neighbour is moved too, and winds up by what that is off: for its sake f has to
  // be exact.
  const bool softens = side == u->side && side * (now - u->still) > 0 && !u->joint->steepens();
  const double bound = softens ? std::max({u->slope, u->used, u->bend}) : std::max(u->steepest, u->used);
  const double own = h * bound * u->weight;
  const auto enough = [&](double off, double torque) {
    const double change = kLeft * std::fabs(torque - u->start);
    return off * own <= change && off * stiffest_ <= std::max(change, kFine * std::fabs(torque));
  };
  // Since it was looked at last, the law has come off its tangent by no more than this: no need to look again.
  if (enough(u->off + std::fabs(velocity - u->seen) * bound, u->law)) return true;
  const double f = u->joint->torque_ahead(u->now, u->state, h, velocity, side);
  const double off = std::fabs(f - u->torque), size = std::fabs(f) + std::fabs(u->torque);
  u->seen = velocity;
  u->off = off;
  u->law = f;
  if (off <= kExact * size) return true;
  if (off * own <= kLeft * std::fabs(f - u->start)) {
    const bool done = enough(off, f);
    u->torque = u->value = f;
    u->origin = velocity;
    u->side = side;
    u->off = 0;
    return done;
  }
  if (side != u->side) {
    hold_or_start(u, side, h);
  } else {
    tangent(u, velocity, h);
  }
  return false;
}

void solve_alone(int count, Alone* alone, double h, Together* t) {
  const int size = t->joint[0]->n_state();
  for (int j = 0; j < count; j++) t->room[j] = t->numbers + j * size;
  Joint::torques(count, t->joint, t->motion, t->state, t->room, t->torque);
  for (int j = 0; j < count; j++) {
    double& f = t->torque[j];
    if (!alone[j].settled(f)) f = alone[j].torque(*t->joint[j], t->state[j], h, kLooks - 1);
  }
}

void Implicit::each_alone(int count, const double* damping, const double* dv, double h) {
  Together t;
  Alone alone[kTogether];
  for (int i = 0, n; i < count; i += n) {
    const Joint* joint = units[i].joint;
    for (n = 0; n < joint->at_once() && i + n < count && units[i + n].joint->alike(*joint); n++) {
      const Unit& u = units[i + n];
      const double free = u.now.velocity + dv[u.dof];
      const double gain = damping ? h * u.weight / (1 + h * u.weight * damping[u.dof]) : h * u.weight;
      alone[n] = {u.now, u.still, free, gain, u.torque, u.steepest, free};
      t.joint[n] = u.joint;
      t.state[n] = u.state;
      t.motion[n] = alone[n].ahead(u.state, h);
    }
    solve_alone(n, alone, h, &t);
    for (int j = 0; j < n; j++) {
      units[i + j].torque = t.torque[j];
      units[i + j].slope = -1;
    }
  }
}

void Implicit::solve(int count, const Inertia& inertia, const double* damping, const double* velocity,
                     const double* tau, double h) {
  const int n = inertia.n;
  bool stiff = false;
  for (int i = 0; i < count; i++) {
    Unit& u = units[i];
    u.still = std::isnan(u.state[0]) ? 0 : (u.state[0] - u.now.position) / h;
    stiff |= h * u.steepest * u.weight > kStiff;
    stiffest_ = std::max(i == 0 ? 0 : stiffest_, h * u.steepest * u.weight);
  }
  for (int i = 0; stiff && i < count; i++) {
    Unit& u = units[i];
    u.forward = u.backward = kUnset;
    u.side = sign(velocity[u.dof] - u.still);
    u.origin = u.still;
    u.value = u.start = u.torque;
    u.seen = kUnset;
    u.bend = 0;
    if (u.slope < 0) hold_or_start(&u, u.side != 0 ? u.side : 1, h);
    u.used = h * u.slope * u.weight < kSoft ? 0 : u.slope;
  }

  double* dv = change_.data();
  bool factored = false;
  for (int iteration = 0; iteration < kIterations; iteration++) {
    bool holds = false, level = !damping && inertia.factor;
    for (int i = 0; i < n; i++) dv[i] = h * tau[i];
    for (int i = 0; i < count; i++) {
      const Unit& u = units[i];
      if (!stiff) {
        dv[u.dof] += h * u.torque;
      } else if (u.used == kInfinity) {
        holds = true;
      } else {
        level &= u.used == 0;
        dv[u.dof] += h * (u.value - u.used * (velocity[u.dof] - u.origin));
      }
    }
    if (level && !holds) {
      substitute(inertia, inertia.factor, inertia.inverse_diagonal, dv);
    } else {
      refresh(stiff ? count : 0, inertia, damping, h, !factored);
      factored = true;
      for (int i = 0; holds && i < count; i++) {
        const Unit& u = units[i];
        const int k = u.dof;
        const double diagonal = inertia.value[inertia.diagonal(k)] + (damping ? h * damping[k] : 0);
        if (u.used == kInfinity) dv[k] = kHold * diagonal * (u.still - velocity[k]);
      }
      substitute(inertia, factor_.data(), diagonal_.data(), dv);
    }
    if (!stiff) return each_alone(count, damping, dv, h);
    if (holds) multiply(inertia, dv, product_.data());
    bool done = true;
    for (int i = 0; i < count; i++) {
      const int k = units[i].dof;
      const double reaction = holds ? product_[k] / h + (damping ? damping[k] * dv[k] : 0) - tau[k] : 0;
      done &= settled(&units[i], velocity[k] + dv[k], velocity[k], reaction, h);
    }
    if (done) return;
  }
  sweep(count, inertia, damping, velocity, tau, h);
}

void Implicit::sweep(int count, const Inertia& inertia, const double* damping, const double* velocity,
                     const double* tau, double h) {
  const int n = inertia.n;
  std::copy(inertia.value, inertia.value + factor_.size(), factor_.begin());
  for (int i = 0; damping && i < n; i++) {
    factor_[inertia.diagonal(i)] += h * damping[i];
  }
  factor(inertia, factor_.data(), diagonal_.data());
  double* x = change_.data();
  for (int i = 0; i < n; i++) x[i] = h * tau[i];
  substitute(inertia, factor_.data(), diagonal_.data(), x);
  for (int i = 0; i < count; i++) free_[i] = velocity[units[i].dof] + x[units[i].dof];
  for (int j = 0; j < count; j++) {
    std::fill(x, x + n, 0.0);
    x[units[j].dof] = h;
    substitute(inertia, factor_.data(), diagonal_.data(), x);
    for (int i = 0; i < count; i++) response_[i * count + j] = x[units[i].dof];
    search_[j] = Joint::Search();
    search_[j].velocity = velocity[units[j].dof];
    push_[j] = units[j].torque;
  }
  for (int pass = 0, changed = 1; pass < 100 && changed; pass++) {
    changed = 0;
    for (int i = 0; i < count; i++) {
      Unit& u = units[i];
      const double *row = &response_[i * count], gain = row[i];
      double v = free_[i];
      for (int j = 0; j < count; j++) v += j == i ? 0 : row[j] * push_[j];
      if (pass > 0 && std::fabs(v - solved_[i]) <= 1e-9 * gain * std::fabs(push_[i])) continue;
      changed = count > 1;
      solved_[i] = v;
      push_[i] = u.torque = u.joint->implicit_torque(u.now, u.state, h, v, gain, &search_[i]);
    }
  }
  for (int i = 0; i < count; i++) units[i].slope = -1;
}

}  // namespace gms
