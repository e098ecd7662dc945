#include "effect.h"

namespace {

enum { kPull, kLevel };  // state: bristle force sigma0 z; what multiplies its level, along the last motion; 0 before any
int n_state(int) { return 2; }
int n_memory(int) { return 1; }

void recall(const double* p, int, const double* unknown, double* state) {
  state[kPull] = unknown[0] * p[2];
  state[kLevel] = 0;
}

double level_at(const double* p, double v, double direction, const gms::Level& level) {
  return gms::stribeck_level(v, p[2], p[3], p[4], p[5], p[9]) * level.at(direction);
}

// The pull along the motion below which the bristle only bends.
double edge_at(const double* p, double direction, const gms::Level& level) { return p[7] * p[2] * level.at(direction); }

// sigma1 at a velocity.
double damping_at(const double* p, double v) {
  return p[6] > 0 ? p[1] * gms::decay((v / p[6]) * (v / p[6])) : p[1];
}

// alpha, by which a bristle gives way of whose pull from where it only bends to its level the share `left` is missing:
// (1 + cos(pi left)) / 2, by a polynomial good to 1e-8, which is quicker than std::cos.
double giving_way(double left) {
  const double x = std::fmin(std::fmax(left, 0), 1) - 0.5, y = x * x;
  const double sine = 3.14159264 + y * (-5.16771008 + y * (2.55007739 + y * (-0.59829041 + y * 0.07765591)));
  return 0.5 - 0.5 * x * sine;
}

// Share of its speed by which a bristle slips that pulls so hard along the motion: none below `edge`.
double slip(double edge, double along, double s) {
  return (edge == 0 ? 1 : giving_way((s - along) / (s - edge))) * along / s;
}

// What is missing of a pull up to s, in parts of what lies between it and the `share` of s below which the bristle only
// bends, after a way in those parts: the solution of left' = alpha (1 - (1 - share) left) - 1, by Runge and Kutta; near its
// end, as a series of alpha has it.
double left_to_give(double left, double share, double way) {
  constexpr double kStep = 0.2, kNear = 0.02, kBend = 2.4674011002723395;  // pi^2 / 4
  const double slope = 1 - share;
  const auto rate = [slope](double x) { return giving_way(x) * (1 - slope * x) - 1; };
  while (left > kNear && way > 0) {
    const double h = std::fmin(way, kStep), a = rate(left), b = rate(left + h / 2 * a), c = rate(left + h / 2 * b);
    left += h / 6 * (a + 2 * b + 2 * c + rate(left + h * c));
    way -= h;
  }
  if (way <= 0) return left;
  const double decay = gms::decay(slope * way);
  return left <= 0 ? left * decay : slope * left * decay / (slope + kBend * left * (1 - decay));
}

// The pull of a bristle of stiffness k along the motion after a way, where s stays.
double bent(double edge, double k, double along, double way, double s) {
  if (edge == 0) return s + (along - s) * std::exp(-k * way / s);
  const double room = (edge - along) / k;  // up to where it only bends
  if (room >= way) return along + k * way;
  if (room > 0) {
    along = edge;
    way -= room;
  }
  const double width = s - edge;
  return s - width * left_to_give((s - along) / width, edge / s, k * way / width);
}

// By how much more a bristle pulls, after a way of so many s / sigma0, where s grows evenly by 1 than where it stays as it
// is on average: it lags behind, and the less the longer the way.
double following(double way) {
  const double decayed = std::expm1(-way);
  return way > 0 ? 1 + decayed / 2 + decayed / way : 0;
}

// The pull of a bristle of stiffness k along the motion after a way, on which s goes evenly from one value to another.
double pulled(double edge, double k, double along, double way, double from, double to) {
  const double s = (from + to) / 2;
  if (!(s > 0)) return 0;
  const double pull = bent(edge, k, along, way, s);
  return to == from || pull < edge ? pull : pull + (to - from) * following(k * way / s);
}

// The torque of a spring with a damper beside it, cut off at the level, at the end of an interval, and its state there.
double cut_off(const double* p, const gms::Motion& m, const gms::Level& level, const double* state, double* next) {
  const double direction = gms::sign(m.displacement), damping = damping_at(p, m.rate());
  double w = state[kPull];
  if (direction != 0) {
    const double k = p[0] * level.stiffness_at(direction);
    const double s = gms::stribeck_level(m, p[2], p[3], p[4], p[5], p[9]) * level.at(direction);
    // While both together pull as hard as the level lets them, the spring goes towards that as its damper lets it.
    const double left = damping > 0 ? gms::decay(k * m.duration / damping) : 0;
    const double most = s - (s - w) * left, least = -s + (w + s) * left;
    w = std::fmin(std::fmax(w + k * m.displacement, least), most);
  }
  next[kPull] = w;
  next[kLevel] = state[kLevel];
  const double s = level_at(p, m.velocity, m.velocity, level);
  return -std::fmin(std::fmax(w + damping_at(p, m.velocity) * m.velocity, -s), s);
}

double torque(const double* p, int, const gms::Motion& m, const gms::Level& level, const double* state,
              double* next) {
  if (p[8] > 0) return cut_off(p, m, level, state, next);
  const double direction = gms::sign(m.displacement), before = direction * state[kLevel];
  double w = state[kPull], along = state[kLevel];
  if (direction != 0) {  // exact over the interval, with the curve at its mean velocity and a multiplier that goes evenly
    const double now = level.at(direction), from = before > 0 ? before : now;
    const double curve = gms::stribeck_level(m, p[2], p[3], p[4], p[5], p[9]), k = p[0] * level.stiffness_at(direction);
    const double edge = edge_at(p, direction, level), way = std::fabs(m.displacement);
    w = direction * pulled(edge, k, direction * w, way, from * curve, now * curve);
    along = direction * now;
  }
  next[kPull] = w;
  next[kLevel] = along;
  if (p[1] == 0 || m.velocity == 0) return -w;
  const double s = level_at(p, m.velocity, m.velocity, level);
  const double slips = s > 0 ? slip(edge_at(p, m.velocity, level), gms::sign(m.velocity) * w, s) : 1;
  return -w - damping_at(p, m.velocity) * m.velocity * (1 - slips);
}

}  // namespace

extern const gms::Effect gms_effect_lugre;
const gms::Effect gms_effect_lugre = {
    "lugre",
    "LuGre",
    "friction",
    "LuGre friction, F = sigma0 z + sigma1 dz/dt with dz/dt = v - sigma0 |v| z / s(v): one bristle that bends and\n"
    "follows s(v) = Fc + (Fs - Fc) exp(-|v/Vs|^delta). Its viscous term sigma2 v is the effect `viscous`.\n"
    "The bristle is integrated exactly over each interval, with s taken at its mean velocity; what multiplies s goes\n"
    "evenly from its value before to its value after: a bristle that follows a level which changes with the place is\n"
    "damped too. It has no non-local memory: minor loops do not close, and it creeps under a varying load below\n"
    "break-away.\n"
    "With a damping velocity Vd > 0 sigma1 exp(-(v/Vd)^2) stands for sigma1: what damps the bristle of a contact at rest\n"
    "is gone when it slides. Vd = 0, the default, is no unknown of a fit; any other value, or none (NaN), is.\n"
    "With an elastic share e > 0 the bristle only bends while it pulls less than e Fc along the motion, and slips beyond\n"
    "with dz/dt = v (1 - alpha sigma0 |z| / s(v)), where alpha = sin^2(pi/2 (sigma0 |z| - e Fc) / (s(v) - e Fc)), and 1\n"
    "above s: it neither creeps below e Fc nor gives way as it unbends. Integrated to 3e-5 of s, which stays as above.\n"
    "With `plastic` it is a spring with a damper beside it, cut off at the level: F = clip(sigma0 z + sigma1 v, +-s(v)),\n"
    "and while it slides, its spring goes to s(v) as the damper lets it. It neither creeps nor gives way below its level.\n"
    "With a tail t > 0 (1 + t |v/Vs|^delta)^(-1/t) stands for the exponential: of t = 1 and delta = 2, 1/(1 + (v/Vs)^2).\n"
    "Source: Canudas de Wit, Olsson, Astrom and Lischinsky, IEEE Trans. Automatic Control 40 (1995); for Vd, Olsson,\n"
    "Astrom, Canudas de Wit, Gafvert and Lischinsky, European Journal of Control 4 (1998);\n"
    "for e, Dupont, Hayward, Armstrong and Altpeter, IEEE Trans. Automatic Control 47 (2002);\n"
    "for `plastic`, Kikuuwe, Takesue, Sano, Mochiyama and Fujimoto, IEEE Trans. Robotics 22 (2006);\n"
    "for t, Hess and Soom, ASME J. Tribology 112 (1990).",
    "The torque error draws loops against position after each reversal, and steps with the sign of velocity.",
    "Reversals at amplitudes around the break-away distance, and slow constant-velocity runs.",
    {{"stiffness", "N m/rad", gms::kUnset, 0, gms::kInfinity, false, true, "sigma0, of the bristle"},
     {"damping", "N m s/rad", 0, 0, gms::kInfinity, false, true, "sigma1, of the bristle"},
     {"coulomb", "N m", gms::kUnset, 0, gms::kInfinity, false, true, "Fc, level at high velocity"},
     {"static", "N m", gms::kUnset, 0, gms::kInfinity, false, true, "Fs, level at zero velocity", false, "coulomb"},
     {"stribeck_velocity", "rad/s", gms::kUnset, 1e-12, gms::kInfinity, false, true, "Vs, velocity at which the level has weakened"},
     {"stribeck_exponent", "1", 2.0, 0.1, 10, false, false, "delta, shape of the weakening"},
     {"damping_velocity", "rad/s", 0, 0, gms::kInfinity, false, true, "Vd, velocity at which the damping is gone; 0: it stays"},
     {"elastic", "1", 0, 0, 0.95, false, false, "e, share of Fc below which the bristle only bends; 0: none"},
     {"plastic", "1", 0, 0, 1, false, false, "1: a damped spring, cut off at the level, whatever e"},
     gms::kStribeckTail},
    n_state,
    n_memory,
    recall,
    nullptr,
    torque,
    nullptr,
    true,
};
