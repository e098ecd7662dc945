#include "effect.h"

namespace {

enum { kAmplitude, kViscous, kTime, kStiffening, kSpeed, kScale, kWhole, kAnew };  // parameters

constexpr double kColdest = -50;  // heat, below which what is left would be no friction, and at last no number

int n_state(int) { return 1; }

// Whether heat is a state, and does not come with time alone.
bool heats(const double* p) { return p[kSpeed] > 0 || p[kScale] > 0; }

// What heat goes to over an interval: what the thermometer says, or what friction gives.
double goal(const double* p, const gms::Motion& m) {
  if (p[kScale] > 0) return std::fmax((m.temperature - gms::kRoom) / p[kScale], kColdest);
  return std::fabs(m.displacement) / (m.duration * p[kSpeed]);
}

// Heat where an interval begins; a thermometer tells it at the first instant.
double begun(const double* p, const gms::Motion& m, double theta) {
  return p[kScale] > 0 && m.duration == 0 ? goal(p, m) : theta;
}

// When the record began, by its time stamps: the state, which its first instant tells.
double began(const gms::Motion& m, double state) { return m.duration == 0 && state == 0 ? m.time : state; }

// How much of the change is left where the state is this.
double left(const double* p, const gms::Motion& m, double state) {
  if (heats(p)) return std::exp(-state);
  return std::exp(-(p[kAnew] != 0 ? m.time - began(m, state) : m.time) / p[kTime]);
}

void modulate(const double* p, int, const gms::Motion& m, const double* state, gms::Level& level) {
  const double factor = 1 + p[kAmplitude] * left(p, m, begun(p, m, state[0]));
  level.scale(factor, p[kStiffening] != 0, p[kWhole] != 0);
}

double torque(const double* p, int, const gms::Motion& m, const gms::Level&, const double* state, double* next) {
  const double theta = begun(p, m, state[0]);
  next[0] = heats(p) || p[kAnew] == 0 ? theta : began(m, theta);
  if (heats(p) && m.duration > 0) {  // exact at the mean speed of the interval
    const double rest = goal(p, m);
    next[0] = rest + (theta - rest) * std::exp(-m.duration / p[kTime]);
  }
  return -p[kViscous] * m.velocity * left(p, m, next[0]);
}

}  // namespace

extern const gms::Effect gms_effect_thermal_drift;
const gms::Effect gms_effect_thermal_drift = {
    "thermal_drift",
    "ThermalDrift",
    "friction",
    "Friction that settles while the axis warms up: the level of every friction law of the joint is multiplied by\n"
    "1 + a exp(-t/tau), and a drag b exp(-t/tau) is added to the viscous one, t being the time stamp of the record: it\n"
    "begins near zero where the axis was cold; with n = 1 t begins anew with each record, before which the axis has\n"
    "cooled. The other parameters describe the warm axis, so friction that grows from (1 + a) Fc to Fc has a < 0. Grease\n"
    "thins as it warms: in robot joints most of the change is in the drag.\n"
    "So heat comes with time alone, and goes on at rest. With a speed V > 0 it is friction's own: exp(-theta) stands for\n"
    "exp(-t/tau), where tau dtheta/dt = |v|/V - theta from 0 where the record begins, and the axis cools as it rests. With\n"
    "a scale W > 0 it is what was measured, T being the signal `temperature` of a record: tau dtheta/dt = (T - 20)/W - theta\n"
    "from theta = (T - 20)/W, so that a and b are those at 20 degC, where MuJoCo has every joint. V = 0 and W = 0, the\n"
    "defaults, are no unknowns of a fit; any other values are.\n"
    "The stiffness of `gms`, `lugre` and `dahl` follows their level, or with s = 0 stays. What a contact holds at rest is\n"
    "not changed by either; with w = 1 the whole torque of friction is multiplied, that and the drag too, as many a\n"
    "simulation has it.\n"
    "Source: friction during warm-up, Carvalho Bittencourt and Axelsson, IEEE/ASME Trans. Mechatronics 19 (2014), whose\n"
    "viscous friction falls as exp(-T/W).",
    "The torque error follows the sign of velocity, or velocity, and fades, or grows to a plateau, with time.",
    "One motion repeated from a cold start for several minutes, with the temperature logged.",
    {{"amplitude", "1", 0, -0.95, gms::kInfinity, false, true, "a, part of the level that fades"},
     {"viscous", "N m s/rad", 0, -gms::kInfinity, gms::kInfinity, false, true, "b, viscous drag that fades"},
     {"time_constant", "s", gms::kUnset, 0.1, gms::kInfinity, false, true, "tau"},
     {"stiffening", "1", 1, 0, 1, false, false, "s, 1: the stiffness fades with the level; 0: the level alone"},
     {"speed", "rad/s", 0, 0, gms::kInfinity, false, true, "V, speed that in the long run heats to theta = 1; 0: time does"},
     {"temperature_scale", "K", 0, 0, gms::kInfinity, false, true, "W, rise of the temperature that is theta = 1; 0: not used"},
     gms::kWholeTorque,
     {"anew", "1", 0, 0, 1, false, false, "n, 1: t is from where a record begins; 0: t is its time stamp"}},
    n_state,
    nullptr,
    nullptr,
    modulate,
    torque,
};
