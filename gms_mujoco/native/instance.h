// An instance of the plug-in as it stands in a model: the joints it acts on, their friction, and where all that is kept
// in mjModel and mjData.
#ifndef GMS_MUJOCO_NATIVE_INSTANCE_H_
#define GMS_MUJOCO_NATIVE_INSTANCE_H_

#include <mujoco/mujoco.h>

#include <cstddef>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "config.h"
#include "implicit.h"
#include "joint.h"

// The symbols of libmujoco in use, the version first. Only the last is a variable. libmujoco is not linked: Python hands
// over the addresses of its functions, after a look at its version.
#define GMS_SYMBOLS(X)                                                                                   \
  X(mj_version) X(mju_error) X(mju_warning) X(mjp_defaultPlugin) X(mjp_registerPlugin) X(mj_getPluginConfig)  \
  X(mj_name2id) X(mj_rne) X(mj_fwdActuation) X(mj_applyFT) X(mjcb_control)

namespace gms {

struct Engine {
#define GMS_MEMBER(name) decltype(&::name) name = nullptr;
  GMS_SYMBOLS(GMS_MEMBER)
#undef GMS_MEMBER
};

extern Engine engine;
extern int plugin_slot;  // of the friction plug-in, in MuJoCo's table

// After the joint's own state, in plugin_state: the torque on the joint now; where the next evaluation starts from: the
// torque that the last advance found, and the velocity it found it at (kLargest: it has not moved since the reset).
// Unless an explicit step is asked for, the acceleration that had led there and what was left of it without the joint's
// own torque (kLargest: not known), the slope of the law in the last implicit step (below 0: not known), the torque of
// contacts, limits and equalities in that step, the inertia that they are like, and how much that is founded on. Last,
// where friction depends on it, the load: what the gear transmitted to the link in the last step. A batch copies all of it
// in every step, so that nothing stands here that may stand elsewhere.
enum {
  kTorque = 0, kAhead, kAheadVelocity, kExplicit,
  kPastAcceleration = kExplicit, kFromOthers, kSlope, kConstraint, kBurden, kFounded, kImplicit
};

// What stands for infinity there, so that every number of a state is finite once a step has been made.
constexpr double kLargest = std::numeric_limits<double>::max();

// How a joint is integrated.
enum { kAuto = 0, kForcedExplicit, kForcedImplicit };

struct Unit {  // one joint, as its model has it
  const Joint* joint = nullptr;
  std::ptrdiff_t dof = -1, place = -1, tree = -1, state_start = -1, book_start = -1;  // place: in qpos
  std::ptrdiff_t load = -1;  // where in its book the load is; none: below 0
  int n_state = 0, integration = kAuto;
  bool implicit = false;
  double timestep = -1, weight = -1, slope = 0, stiffness = 0;  // for which `implicit` was chosen; their product

  bool late() const { return implicit; }

  // Where mjData has what belongs to the joint: the state, and behind it what is noted with it; the torque that passive
  // forces add up to.
  double* state(const mjData* d) const { return d->plugin_state + state_start; }
  double* book(const mjData* d) const { return d->plugin_state + book_start; }
  double& passive(const mjData* d) const { return d->qfrc_passive[dof]; }
  bool asleep(const mjData* d) const { return d->tree_asleep[tree] >= 0; }
  Sample now(const mjData* d) const {
    return {d->time, d->qpos[place], d->qvel[dof], load < 0 ? 0 : book(d)[load]};
  }
};

// What a model says of the joints of an instance. Every mjData that is made of the model, or of one that says the same,
// has it in common: of a batch of worlds one stays in the cache.
struct Plan {
  std::shared_ptr<const std::vector<std::unique_ptr<Joint>>> joints;  // their frictions
  std::vector<Unit> units;
};

struct Late {  // a joint of one mjData that waits for the torque of the actuators
  // What qfrc_passive was without us, and what we wrote there. Not in plugin_state: mj_setState and finite differences
  // put that back, and qfrc_passive stays.
  double base = 0, sum = 0;
  double own = 0;      // torque on the joint in this step, friction included
  double assumed = 0;  // of it what constraints give, as far as one knows before they are solved
  double slope = -1;   // of the law in this step; below 0: not known
};

constexpr int kFew = 32;  // implicit joints that are solved for on the stack, which stays in the cache from world to world

// Joints of an instance that have the same friction.
struct Served {
  std::vector<int> joints;
  int integration = kAuto;
  std::unique_ptr<Joint> joint = std::make_unique<Joint>();

  int n_book() const { return integration == kForcedExplicit ? kExplicit : kImplicit; }  // without the load
  int n_numbers() const { return joint->n_state() + n_book() + joint->reads_load(); }    // of each in plugin_state
};

struct Instance {
  std::shared_ptr<const Plan> plan;
  std::vector<Late> late;  // for each joint

  const std::vector<Unit>& units() const { return plan->units; }
};

struct Active {  // a late joint that is solved for
  const Unit* unit;
  Late* late;
};

// All instances of one mjData, and room to work in. Owned by its instances together.
struct Group {
  std::vector<Instance*> instances;
  int n_late = 0;
  bool inside = false;  // mj_fwdActuation, called by us
  Implicit implicit;
  std::vector<Implicit::Unit> many;  // where the stack has no room
  std::vector<double> tau, actuator, bias, force, damping;
  std::vector<Active> active;
};

// The text of a key in the <config> of an instance.
Config config(const mjModel* m, int id);

std::string instance_name(const mjModel* m, int id);

// The names of the joints, for the end of a message.
std::string the_joints(const mjModel* m);

// The joints that an instance serves, and their friction. Joints that the model does not have are left out, so long as it
// has one of them, and named in `absent` (may be null): a part of a model takes the whole instance along. Returns what is
// wrong, or nothing.
std::string read_served(const mjModel* m, int id, std::vector<Served>* out, std::string* absent = nullptr);

// Reads an instance from its config. Returns what is wrong, or nothing.
std::string read_instance(const mjModel* m, int id, Instance* out);

// The plan that says the same, where one of the last few does; else this one.
std::shared_ptr<const Plan> in_common(Plan plan);

}  // namespace gms

#endif  // GMS_MUJOCO_NATIVE_INSTANCE_H_
