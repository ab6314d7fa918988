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
// The wait between claims that fail doubles up to this many times quiet / 2.
constexpr int kMostFailures = 5;
constexpr BootTime kNever = BootTime::max();
// Two members of one name end each other's session at least once in this time.
constexpr std::chrono::minutes kNoOtherOfTheName{3};
// Causes of faults.
constexpr const char* kThird = "third";
constexpr const char* kSameName = "name";

}  // namespace

std::string_view to_string(PairRole role) {
  if (role == PairRole::active) return "active";
  return role == PairRole::claiming ? "claiming" : "standby";
}

void PairState::enter(PairRole role, std::string why, BootTime now) {
  role_ = role;
  why_ = std::move(why);
  since_ = now;
  status_due_ = true;
}

void PairState::fault(const std::string& cause, const std::string& text) {
  const auto known = faults_.find(cause);
  const bool lasts = known != faults_.end();
  if (lasts != text.empty() || (!lasts && faults_.size() >= kMostFaults)) return;
  fault_news_.push_back({lasts ? known->second : text, lasts});
  if (lasts)
    faults_.erase(known);
  else
    faults_[cause] = text;
}

PairFault PairState::take_fault() {
  if (fault_news_.empty()) return {};
  PairFault next = std::move(fault_news_.front());
  fault_news_.pop_front();
  return next;
}

void PairState::remember(const std::string& boot) {
  if (boots_.size() < kMostBoots) boots_.insert(boot);
}

// ---- the member session -------------------------------------------------------------------------

void PairState::joined(BootTime now) {
  joined_at_ = now;
  own_status_came_ = false;
  peers_.clear();
  status_due_ = true;
}

void PairState::left(bool taken_over) {
  joined_at_.reset();
  peers_.clear();
  same_name_ = same_name_ || taken_over;
}

void PairState::heard(const PairStatus& status, BootTime now) {
  if (status.boot == settings_.boot) {
    own_status_came_ = own_status_came_ || status.member == settings_.member;
    // The last will of an earlier session has replaced it.
    if (status.role == "offline") status_due_ = true;
    return;
  }
  remember(status.boot);
  const std::string quiet = "quiet_ms of member " + status.member;
  if (status.quiet == settings_.quiet) {
    if (status.role != "offline") fault(quiet, {});
  } else if (status.quiet != nanoseconds(0)) {
    const nanoseconds longer = std::max(nanoseconds(0), status.quiet - quiet_);
    quiet_ += longer;
    if (role_ == PairRole::claiming) opens_at_ += longer;
    if (status.role != "offline")
      fault(quiet, quiet + " is " + whole_ms(status.quiet) + ", and of member " + settings_.member +
                       " " + whole_ms(settings_.quiet) +
                       ": make them equal; until then both wait for the longer one");
  }
  if (status.role == "offline") {
    if (gone_.size() < kMostBoots) gone_.insert(status.boot);
    if (peers_.erase(status.boot) != 0) status_due_ = true;
    // The last will of an earlier process has replaced our own status.
    if (status.member == settings_.member) status_due_ = true;
    if (holder_ == status.boot) holder_.clear();
    return judge_third(now);
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
  if (known == peers_.end()) status_due_ = true;
  peers_[status.boot] = {status.member, status.role, status.is_third, was_here};
  judge_third(now);
}

/// The gateway that finds two others is the third. Gateways that come together are ordered by name.
void PairState::judge_third(BootTime now) {
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
  if (others.size() >= 2 && role_ == PairRole::standby && comes_last) third_ = true;
  // If one of the pair has ended, the other one takes over, and this gateway only then is the
  // second.
  if (was && !third_) not_before_ = std::max(not_before_, now + 3 * quiet_);
  if (third_ != was) status_due_ = true;
}

void PairState::heard_heartbeat(const std::string& boot, std::uint64_t seq, BootTime now) {
  highest_seq_ = std::max(highest_seq_, seq);
  if (boot == settings_.boot) return;
  remember(boot);
  if (gone_.contains(boot)) return;
  holder_ = boot;
  holder_heard_at_ = now;
}

std::string PairState::peer() const {
  std::string name;
  for (const auto& [boot, peer] : peers_)
    if (!peer.is_third && (name.empty() || peer.role != "standby")) name = peer.member;
  return name;
}

// ---- the lease session --------------------------------------------------------------------------

std::optional<BootTime> PairState::claim_at() const {
  if (role_ != PairRole::standby || connecting_ || !joined_at_ || third_) return std::nullopt;
  // If both gateways start at once, the one with the lower name claims first.
  const bool waits_for_lower_name = std::ranges::any_of(peers_, [this](const auto& each) {
    return !each.second.is_third && each.second.member < settings_.member;
  });
  BootTime at = *joined_at_ + quiet_ / 2;
  if (waits_for_lower_name && since_ == BootTime{}) at += quiet_ / 4;
  if (!holder_.empty()) at = std::max(at, holder_heard_at_ + quiet_ / 2);
  return std::max(at, not_before_);
}

void PairState::lease_began(BootTime now) {
  connecting_ = false;
  failures_ = 0;
  sent_.clear();
  opens_at_ = now + quiet_;
  holds_until_ = {};
  heartbeat_at_ = now;
  enter(PairRole::claiming,
        holder_.empty() ? "no gateway is active" : "the active gateway is silent", now);
}

void PairState::lease_ended(bool taken_over, BootTime now) {
  connecting_ = false;
  drop_ = false;
  sent_.clear();
  holds_until_ = {};
  if (role_ == PairRole::standby) {
    failures_ = std::min(failures_ + 1, kMostFailures);
    not_before_ = now + quiet_ / 2 * (1 << (failures_ - 1));
    return;
  }
  // The new holder's first heartbeat may still be on its way.
  not_before_ = now + quiet_;
  enter(PairRole::standby,
        taken_over ? "the other gateway has claimed the pair"
                   : "its session has ended: the broker or the network is away, or this process "
                     "was paused",
        now);
}

void PairState::heartbeat_sent(std::uint64_t id, BootTime now) {
  sent_[id] = now;
  if (sent_.size() > kMostSent) sent_.erase(sent_.begin());
  heartbeat_at_ = now + settings_.quiet / 6;
}

void PairState::heartbeat_acknowledged(std::uint64_t id) {
  const auto found = sent_.find(id);
  if (found == sent_.end() || role_ == PairRole::standby) return;
  holds_until_ = std::max(holds_until_, found->second + settings_.quiet / 2);
  sent_.erase(sent_.begin(), std::next(found));
}

void PairState::has_claimed() {
  sent_.clear();
  holds_until_ = {};
}

std::vector<PairState::Order> PairState::step(BootTime now) {
  std::vector<Order> orders;
  if (std::exchange(same_name_, false)) {
    same_name_at_ = now;
    fault(kSameName, "two gateways are member " + settings_.member +
                         " of this pair: give each its own pair.member");
  }
  if (knows_peer(now)) {
    std::set<std::string> members;
    for (const auto& [boot, peer] : peers_) members.insert(peer.member);
    if (members.size() < 2) fault(kThird, {});
    if (now >= std::max(same_name_at_, *joined_at_) + kNoOtherOfTheName) fault(kSameName, {});
  }
  if (role_ == PairRole::claiming && agent_runs_ && now >= opens_at_ && now < holds_until_)
    enter(PairRole::active, why_, now);
  if (const auto at = claim_at(); at && now >= *at) {
    connecting_ = true;
    orders.push_back(Order::connect_lease);
  }
  if (role_ != PairRole::standby) {
    // A session whose broker has answered nothing for so long is of no use.
    const BootTime last_sign = std::max(holds_until_, opens_at_ - quiet_);
    if (now >= last_sign + 2 * quiet_ && !std::exchange(drop_, true))
      orders.push_back(Order::drop_lease);
    if (now >= heartbeat_at_) orders.push_back(Order::send_heartbeat);
  }
  if (joined_at_ && std::exchange(status_due_, false)) orders.push_back(Order::publish_status);
  return orders;
}

BootTime PairState::next_wake() const {
  BootTime wake = claim_at().value_or(kNever);
  if (role_ == PairRole::standby) return wake;
  wake = std::min(wake, heartbeat_at_);
  if (role_ == PairRole::claiming && agent_runs_) wake = std::min(wake, opens_at_);
  return wake;
}

}  // namespace fxagent
