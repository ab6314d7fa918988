#include "agent/pair/pair_state.h"

#include <algorithm>

#include "agent/steady_time.h"

namespace fxagent {
namespace {

using std::chrono::nanoseconds;

// What is remembered; a pair has two gateways. Other clients may send any names.
constexpr std::size_t kMostBoots = 256;
constexpr std::size_t kMostPeers = 16;
constexpr std::size_t kMostFaults = 16;
constexpr std::size_t kMostSent = 64;
// Two members of one name end each other's session at least once in this time.
constexpr std::chrono::minutes kNoOtherOfTheName{3};
// Causes of faults.
constexpr const char* kThird = "third";
constexpr const char* kSameName = "name";
// The wait between claims that fail doubles up to this many times quiet / 2.
constexpr int kMostFailures = 5;
constexpr BootTime kNever = BootTime::max();

void remember(std::string boot, std::set<std::string>& boots) {
  if (boots.size() < kMostBoots) boots.insert(std::move(boot));
}

}  // namespace

std::string_view to_string(PairRole role) {
  if (role == PairRole::active) return "active";
  return role == PairRole::claiming ? "claiming" : "standby";
}

void PairPeers::joined(BootTime now) {
  joined_at_ = now;
  own_status_came_ = false;
  peers_.clear();
  changed_ = true;
}

void PairPeers::left(bool taken_over) {
  joined_at_.reset();
  peers_.clear();
  same_name_ = same_name_ || taken_over;
}

void PairPeers::heard(const PairStatus& status, PairRole role, BootTime now) {
  if (status.boot == settings_.boot) {
    own_status_came_ = own_status_came_ || status.member == settings_.member;
    // The last will of an earlier session has replaced it.
    if (status.role == "offline") changed_ = true;
    return;
  }
  remember(status.boot, boots_);
  const std::string quiet = "quiet_ms of member " + status.member;
  if (status.quiet == settings_.quiet) {
    if (status.role != "offline") fault(quiet, {});
  } else if (status.quiet != nanoseconds(0)) {
    quiet_ = std::max(quiet_, status.quiet);
    if (status.role != "offline")
      fault(quiet, quiet + " is " + whole_ms(status.quiet) + ", and of member " + settings_.member +
                       " " + whole_ms(settings_.quiet) +
                       ": make them equal; until then both wait for the longer one");
  }
  if (status.role == "offline") {
    remember(status.boot, gone_);
    if (peers_.erase(status.boot) != 0) changed_ = true;
    // The last will of an earlier process has replaced our own status.
    if (status.member == settings_.member) changed_ = true;
    if (holder_ == status.boot) holder_heard_at_.reset();
    return judge_third(role, now);
  }
  gone_.erase(status.boot);  // only its session had ended
  // A text from before our own is that of an earlier process.
  if (status.member == settings_.member) {
    same_name_ = same_name_ || own_status_came_;
    return;
  }
  std::erase_if(peers_, [&](const auto& each) {
    return each.second.member == status.member && each.first != status.boot;
  });
  if (peers_.size() >= kMostPeers) return;
  // The broker sends the statuses that it has before the one that we publish when we have joined.
  const auto known = peers_.find(status.boot);
  const bool was_here = known == peers_.end() ? !own_status_came_ : known->second.was_here;
  if (known == peers_.end()) changed_ = true;
  peers_[status.boot] = {status.member, status.role, status.is_third, was_here};
  judge_third(role, now);
}

/// The gateway that finds two others is the third. Gateways that come together are ordered by name.
void PairPeers::judge_third(PairRole role, BootTime now) {
  std::set<std::string> others;
  std::set<std::string> before;
  std::set<std::string> all;
  for (const auto& [boot, peer] : peers_) {
    all.insert(peer.member);
    if (!peer.is_third) others.insert(peer.member);
    if (!peer.is_third && peer.was_here) before.insert(peer.member);
  }
  if (all.size() >= 2) {
    std::string names;
    for (const std::string& name : all) names += (names.empty() ? "" : ", ") + name;
    fault(kThird, "a pair has two gateways, and besides member " + settings_.member +
                      " there are " + names + ": stop one, or give it another agent.id");
  }
  const bool was = third_;
  if (others.size() < 2) third_ = false;
  const bool is_new = joined_at_ && now < *joined_at_ + quiet_ / 2;
  const bool is_last_name = !others.empty() && *others.rbegin() < settings_.member;
  const bool comes_last = before.size() >= 2 || (is_new && is_last_name);
  if (others.size() >= 2 && role == PairRole::standby && comes_last) third_ = true;
  if (third_ != was) changed_ = true;
}

void PairPeers::heard_heartbeat(const std::string& member, const std::string& boot,
                                std::uint64_t seq, BootTime now) {
  highest_seq_ = std::max(highest_seq_, seq);
  if (boot == settings_.boot) return;
  std::uint64_t& highest = member == settings_.member ? own_seq_ : other_seq_;
  highest = std::max(highest, seq);
  remember(boot, boots_);
  if (gone_.contains(boot)) return;
  holder_ = boot;
  holder_heard_at_ = now;
}

std::string PairPeers::peer() const {
  std::string name;
  for (const auto& [boot, peer] : peers_)
    if (!peer.is_third && (name.empty() || peer.role != "standby")) name = peer.member;
  return name;
}

void PairPeers::fault(const std::string& cause, const std::string& text) {
  const auto known = faults_.find(cause);
  const bool lasts = known != faults_.end();
  if (lasts != text.empty() || (!lasts && faults_.size() >= kMostFaults)) return;
  fault_news_.push_back({lasts ? known->second : text, lasts});
  if (lasts)
    faults_.erase(known);
  else
    faults_[cause] = text;
}

PairFault PairPeers::take_fault() {
  if (fault_news_.empty()) return {};
  PairFault next = std::move(fault_news_.front());
  fault_news_.pop_front();
  return next;
}

bool PairPeers::has_lower_name() const {
  return std::ranges::any_of(peers_, [this](const auto& each) {
    return !each.second.is_third && each.second.member < settings_.member;
  });
}

void PairPeers::step(BootTime now) {
  if (std::exchange(same_name_, false)) {
    same_name_at_ = now;
    fault(kSameName, "two gateways are member " + settings_.member +
                         " of this pair: give each its own pair.member");
  }
  if (!has_listened(now)) return;
  std::set<std::string> members;
  for (const auto& [boot, peer] : peers_) members.insert(peer.member);
  if (members.size() < 2) fault(kThird, {});
  if (now >= std::max(same_name_at_, *joined_at_) + kNoOtherOfTheName) fault(kSameName, {});
}

// ---- PairState ----------------------------------------------------------------------------------

void PairState::enter(PairRole role, std::string why, BootTime now) {
  role_ = role;
  why_ = std::move(why);
  since_ = now;
  status_due_ = true;
}

void PairState::heard(const PairStatus& status, BootTime now) {
  const bool was_third = peers_.is_third();
  peers_.heard(status, role_, now);
  if (role_ == PairRole::claiming) opens_at_ = since_ + peers_.quiet();
  // One of the pair has ended. The other one takes over: only then is this gateway the second.
  if (was_third && !peers_.is_third())
    not_before_ = std::max(not_before_, now + 3 * peers_.quiet());
}

std::optional<BootTime> PairState::claim_at() const {
  const auto joined_at = peers_.joined_at();
  if (role_ != PairRole::standby || connecting_ || !joined_at || peers_.is_third())
    return std::nullopt;
  const nanoseconds quiet = peers_.quiet();
  BootTime at = *joined_at + quiet / 2;
  // If both gateways start at once, the one with the lower name claims first.
  if (peers_.has_lower_name() && since_ == BootTime{}) at += quiet / 4;
  if (const auto heard_at = peers_.holder_heard_at()) at = std::max(at, *heard_at + quiet / 2);
  return std::max(at, not_before_);
}

void PairState::lease_began(BootTime now) {
  connecting_ = false;
  failures_ = 0;
  sent_.clear();
  opens_at_ = now + peers_.quiet();
  holds_until_ = {};
  heartbeat_at_ = now;
  enter(PairRole::claiming,
        !peers_.holder_heard_at() ? "no gateway is active" : "the active gateway is silent", now);
}

void PairState::lease_ended(bool taken_over, BootTime now) {
  connecting_ = false;
  drop_ = false;
  sent_.clear();
  holds_until_ = {};
  if (role_ == PairRole::standby) {
    failures_ = std::min(failures_ + 1, kMostFailures);
    not_before_ = now + peers_.quiet() / 2 * (1 << (failures_ - 1));
    return;
  }
  // The new holder's first heartbeat may still be on its way.
  not_before_ = now + peers_.quiet();
  enter(PairRole::standby,
        taken_over ? "the other gateway has claimed the pair"
                   : "its session has ended: the broker or the network is away, or this process "
                     "was paused",
        now);
}

void PairState::heartbeat_sent(std::uint64_t id, BootTime now) {
  sent_[id] = now;
  if (sent_.size() > kMostSent) sent_.erase(sent_.begin());
  heartbeat_at_ = now + quiet_ / 6;
}

void PairState::heartbeat_acknowledged(std::uint64_t id) {
  const auto found = sent_.find(id);
  if (found == sent_.end() || role_ == PairRole::standby) return;
  holds_until_ = std::max(holds_until_, found->second + quiet_ / 2);
  sent_.erase(sent_.begin(), std::next(found));
}

void PairState::has_claimed(BootTime now) {
  sent_.clear();
  claimed_at_ = now;
  holds_until_ = {};
}

std::vector<PairState::Action> PairState::step(BootTime now) {
  std::vector<Action> actions;
  peers_.step(now);
  status_due_ = peers_.take_change() || status_due_;
  if (role_ == PairRole::claiming && agent_runs_ && now >= opens_at_ && now < holds_until_)
    enter(PairRole::active, why_, now);
  if (const auto at = claim_at(); at && now >= *at) {
    connecting_ = true;
    actions.push_back(Action::connect_lease);
  }
  if (role_ != PairRole::standby) {
    // A session whose broker has answered nothing for so long is of no use.
    const BootTime last_sign = std::max({holds_until_, claimed_at_, opens_at_ - peers_.quiet()});
    if (now >= last_sign + 2 * peers_.quiet() && !std::exchange(drop_, true))
      actions.push_back(Action::drop_lease);
    if (now >= heartbeat_at_) actions.push_back(Action::send_heartbeat);
  }
  if (peers_.joined_at() && std::exchange(status_due_, false))
    actions.push_back(Action::publish_status);
  return actions;
}

BootTime PairState::next_wake() const {
  BootTime wake = claim_at().value_or(kNever);
  if (role_ == PairRole::standby) return wake;
  wake = std::min(wake, heartbeat_at_);
  if (role_ == PairRole::claiming && agent_runs_) wake = std::min(wake, opens_at_);
  return wake;
}

}  // namespace fxagent
