#include "effect.h"

namespace {

double torque(const double* p, int, const gms::Motion& m, const gms::Level&, const double*, double*) {
  return p[1] - p[0] * m.position;
}

}  // namespace

extern const gms::Effect gms_effect_spring;
const gms::Effect gms_effect_spring = {
    "spring",
    "Spring",
    "mechanics",
    "Spring to the frame, tau = P - k q: a return spring, a cable bundle, the membrane of a flexure.\n"
    "It rests at q = P/k. The preload P at q = 0 stands in place of the rest position so that the torque is linear in\n"
    "both: a rest position says nothing while k is zero. P alone is `torque_offset`; use one of the two.\n"
    "Source: Hooke's law; joint springs in robot models, e.g. Siciliano et al., Robotics (2009), chapter 7.",
    "The torque error is a straight line against position, the same in both directions and at every speed.",
    "Slow constant-velocity runs over the whole range in both directions: half the sum of the torques.",
    {{"stiffness", "N m/rad", 0, 0, gms::kInfinity, false, true, "k"},
     {"preload", "N m", 0, -gms::kInfinity, gms::kInfinity, false, true, "P, torque at position zero"}},
    nullptr,
    nullptr,
    nullptr,
    nullptr,
    torque,
};
