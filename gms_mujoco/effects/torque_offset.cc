#include "effect.h"

namespace {

double torque(const double* p, int, const gms::Motion&, const gms::Level&, const double*, double*) { return p[0]; }

}  // namespace

extern const gms::Effect gms_effect_torque_offset;
const gms::Effect gms_effect_torque_offset = {
    "torque_offset",
    "TorqueOffset",
    "drive",
    "Constant torque on the joint, tau = T0: offset of the current loop or of the torque sensor.\n"
    "Additive difference of Coulomb levels between the directions looks the same and is this effect's business.\n"
    "Source: the offset term of robot identification models, e.g. Janot, Vandanjon and Gautier, IEEE T-CST 22 (2014).",
    "The torque error is a constant, the same at every speed, position and direction.",
    "Slow runs in both directions over the same positions: half the sum of the torques.",
    {{"torque", "N m", 0, -gms::kInfinity, gms::kInfinity, false, true, "T0, torque added to the drive's"}},
    nullptr,
    nullptr,
    nullptr,
    nullptr,
    torque,
};
