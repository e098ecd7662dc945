// An instance of the plug-in as it stands in a model: the joints it acts on, their friction, and where all that is kept
// in mjModel and mjData.
#ifndef GMS_MUJOCO_NATIVE_INSTANCE_H_
#define GMS_MUJOCO_NATIVE_INSTANCE_H_

#include <mujoco/mujoco.h>

#include <memory>
#include <string>
#include <vector>

#include "config.h"
#include "implicit.h"
#include "joint.h"

// The symbols of libmujoco in use, the version first. Only the last is a variable. libmujoco is not linked: Python hands
// over the addresses of its functions, after a look at its version.
#define GMS_SYMBOLS(X)                                                                                   \
  X(mj_version) X(mju_error) X(mjp_defaultPlugin) X(mjp_registerPlugin) X(mj_getPluginConfig) X(mj_name2id) \
  X(mj_rne) X(mj_fwdActuation) X(mj_applyFT) X(mjcb_control)

namespace gms {

struct Engine {
#define GMS_MEMBER(name) decltype(&::name) name = nullptr;
  GMS_SYMBOLS(GMS_MEMBER)
#undef GMS_MEMBER
};

extern Engine engine;
extern int plugin_slot;  // of the friction plug-in, in MuJoCo's table

// After the joint's own state, in plugin_state: the torque on the joint now; whether it has not moved since the reset;
// where the next evaluation starts from: the torque that the last advance found, the velocity it found it at, the
// acceleration that had led there, and the slope of the law in the last implicit step (below 0: not known); the slope in
// this step; the load: what the gear transmitted to the link in the last step; its acceleration in that step without
// contacts and limits, less what its own torque gave (infinite: not known).
enum { kTorque = 0, kFresh, kAhead, kAheadVelocity, kPastAcceleration, kSlope, kNextSlope, kLoad, kFromOthers, kBookkeeping };

struct Unit {  // one joint
  const Joint* joint = nullptr;
  int dof = -1, state_start = -1, n_state = 0, integration = 0;
  bool implicit = false, reads_load = false;
  double timestep = -1, weight = -1, slope = 0, stiffness = 0;  // for which `implicit` was chosen; their product
  // What qfrc_passive was without us, and what we wrote there. Not in plugin_state: mj_setState and finite differences
  // put that back, and qfrc_passive stays.
  double base = 0, sum = 0;
  double own = 0;  // torque on a late joint in this step, friction included

  // Where mjData has what belongs to the joint: its arrays stay in their places as long as it lives. The state, and behind
  // it what is noted with it; the torque that passive forces add up to.
  double *state = nullptr, *book = nullptr, *passive = nullptr;
  const double *position = nullptr, *velocity = nullptr;
  const int* awake = nullptr;  // below 0: it is

  bool late() const { return implicit; }
  Sample now(const mjData* d) const { return {d->time, *position, *velocity, book[kLoad], 0}; }
  bool asleep() const { return *awake >= 0; }
};

constexpr int kFew = 32;  // implicit joints that are solved for on the stack, which stays in the cache from world to world

// Joints of an instance that have the same friction.
struct Served {
  std::vector<std::string> names;
  int integration = 0;
  std::unique_ptr<Joint> joint = std::make_unique<Joint>();
};

struct Instance {
  std::vector<std::unique_ptr<Joint>> joints;  // their frictions
  std::vector<Unit> units;
};

// All instances of one mjData, and room to work in. Owned by its instances together.
struct Group {
  std::vector<Instance*> instances;
  int n_late = 0;
  bool inside = false;  // mj_fwdActuation, called by us
  Implicit implicit;
  std::vector<Implicit::Unit> many;  // where the stack has no room
  std::vector<double> tau, actuator, bias, force;
  std::vector<Unit*> active;
};

// The text of a key in the <config> of an instance.
Config config(const mjModel* m, int id);

std::string instance_name(const mjModel* m, int id);

// The joints that an instance serves, and their friction. Returns what is wrong, or nothing.
std::string read_served(const mjModel* m, int id, std::vector<Served>* out);

// Reads an instance of `d` from its config. Returns what is wrong, or nothing.
std::string read_instance(const mjModel* m, mjData* d, int id, Instance* out);

}  // namespace gms

#endif  // GMS_MUJOCO_NATIVE_INSTANCE_H_
