#include "agent/pair/pair_member.h"

#include <unistd.h>

#include <algorithm>
#include <utility>
#include <variant>

#include "agent/commands/parse/parse.h"
#include "agent/log/log.h"
#include "agent/pair/pair_messages.h"
#include "agent/process/this_process.h"
#include "agent/uplink/paho/paho_broker.h"
#include "agent/uplink/topics.h"
#include "agent/without_signals.h"

namespace fxagent {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

// The broker keeps the member session for this time, so that a gateway that is restarted misses
// neither an announced command nor a result.
constexpr seconds kKeepSession{3600};
constexpr milliseconds kFarewell{1000};
constexpr milliseconds kShortestWait{2};
constexpr milliseconds kLongestWait{200};
// Sequence numbers that the holder may use until its next heartbeat. A device has at most 1,000
// samples a second.
constexpr std::uint64_t kReserve = 1'000'000;
// Announcements on their way: what the MQTT library sends fast, less a few for the heartbeats,
// which would otherwise wait behind a burst of commands.
constexpr std::uint32_t kMostOnTheWay = 20;
constexpr std::uint32_t kForHeartbeats = 4;
constexpr int kMostClaims = 4;  // times `quiet` until a claim without its mark is given up

MqttConfig settings_with(const MqttConfig& mqtt, const std::string& suffix) {
  MqttConfig own = mqtt;
  own.client_id += suffix;
  return own;
}

/// Writes a line at once: the log's own thread does not outlive a restart.
void write_at_once(std::string line) {
  line += '\n';
  [[maybe_unused]] const auto written = ::write(STDERR_FILENO, line.data(), line.size());
}

}  // namespace

PairMember::PairMember(const Config& config, std::string boot)
    : config_(config),
      pair_(*config.pair),
      boot_(std::move(boot)),
      permit_(pair_.quiet),
      peers_({pair_.member, boot_, pair_.quiet}),
      state_(pair_.quiet, peers_),
      journal_(std::make_unique<StandbyJournal>(config_.store)),
      announcements_(boot_, [this] { wake(); }) {
  const WithoutSignals quiet;
  thread_ = std::jthread([this](const std::stop_token& stop) { run(stop); });
}

PairMember::~PairMember() {
  permit_.revoke();
  thread_.request_stop();
  wake();
}

void PairMember::wake(const std::function<void()>& change) {
  const std::lock_guard lock(mutex_);
  change();
  woken_ = true;
  news_.notify_all();
}

Publication PairMember::offline_status() const {
  const PairStatus status{
      .member = pair_.member, .boot = boot_, .role = "offline", .quiet = pair_.quiet};
  return retained(topic(), pair_messages::status(status));
}

std::string PairMember::topic(const char* leaf) const {
  return pair_messages::topic_of(config_.base_topic(), pair_.member) + leaf;
}

std::uint64_t PairMember::publish(Broker& session, Publication publication) {
  const std::uint64_t id = publication.id = next_id_++;
  session.publish(std::move(publication));
  return id;
}

std::uint64_t PairMember::publish_in_journal(Broker& session, std::string text) {
  return publish(session, {.topic = topic("/journal"), .payload = std::move(text)});
}

// ---- called by other threads --------------------------------------------------------------------

PairMember::Claimed PairMember::await_claim(const std::function<void()>& waits) {
  std::unique_lock lock(mutex_);
  std::uint64_t rounds = rounds_;
  while (!claimed_) {
    if (rounds_ != rounds) {
      rounds = rounds_;
      lock.unlock();
      waits();
      lock.lock();
    }
    news_.wait_for(lock, seconds(1), [this] { return claimed_.has_value(); });
  }
  return std::move(*claimed_);
}

void PairMember::agent_began(Agent agent) {
  wake([&] { agent_ = std::move(agent); });
}

void PairMember::reply(JournalEntry answered) {
  wake([&] { answered_.push_back(std::move(answered)); });
}

void PairMember::leave() {
  permit_.revoke();
  wake([this] { leaving_ = true; });
  std::unique_lock lock(mutex_);
  news_.wait_for(lock, 2 * kFarewell, [this] { return left_; });
}

bool PairMember::knows(const std::string& boot) const {
  const std::lock_guard lock(mutex_);
  return peers_.knows(boot);
}

// ---- the thread ---------------------------------------------------------------------------------

void PairMember::run(const std::stop_token& stop) {
  const auto notify = [this] { wake(); };
  member_.emplace(
      std::make_unique<PahoBroker>(
          settings_with(config_.mqtt, "-pair-" + pair_.member), [this] { return offline_status(); },
          notify, pair_messages::kLongestText, kKeepSession),
      config_.mqtt.servers.size(), config_.base_topic(), peers_);
  lease_ = std::make_unique<PahoBroker>(settings_with(config_.mqtt, "-pair"), MakeWill{}, notify);
  evicting_ = std::make_unique<PahoBroker>(config_.mqtt, MakeWill{}, notify);
  member_->keep(boot_time_now());
  log_changes(boot_time_now());
  std::optional<BootTime> leave_by;
  while (!stop.stop_requested()) {
    {
      std::unique_lock lock(mutex_);
      const auto wait =
          std::clamp<BootTime>(state_.next_wake() - boot_time_now(), kShortestWait, kLongestWait);
      news_.wait_for(lock, wait, [this] { return woken_; });
      woken_ = false;
      ++rounds_;
      if (agent_) {
        agent_->goes_on();
        state_.agent_began();
      }
    }
    const BootTime now = boot_time_now();
    if (leaving_ && !leave_by) {
      leave_by = now + kFarewell;
      lease_->disconnect();
      farewell_ = publish(member_->broker(), offline_status());
    }
    keep(now);
    if (!leave_by || (farewell_ != 0 && now < *leave_by)) continue;
    member_->broker().disconnect();
    break;
  }
  const std::lock_guard lock(mutex_);
  left_ = true;
  news_.notify_all();
}

void PairMember::keep(BootTime now) {
  take_member_events(now);
  take_evicting_events(now);
  take_lease_events(now);
  if (permit_.opens_at() != state_.opens_at()) permit_.open_at(state_.opens_at());
  const bool goes_on = !leaving_ && !over_;
  if (goes_on) {
    permit_.extend(state_.holds_until());
    for (const PairState::Action action : state_.step(now)) carry_out(action, now);
    go_on_with_claim(now);
    log_changes(now);
  }
  const auto announce = [this](std::string text) {
    return publish_in_journal(*lease_, std::move(text));
  };
  announcements_.step(window_, announce, std::chrono::steady_clock::now());
  if (!goes_on) return;
  for (PairFault next = peers_.take_fault(); !next.text.empty(); next = peers_.take_fault()) {
    if (next.is_over)
      log::info("pair", {{"state", "over"}, {"fault", next.text}});
    else
      log::error("pair", {{"fault", next.text}});
  }
  member_->keep(now);
  send_journal(now);
  if (journal_) journal_->upkeep(std::chrono::steady_clock::now());
}

/// Publishes the replies, and the next command that earlier processes of this gateway left.
void PairMember::send_journal(BootTime now) {
  std::deque<JournalEntry> answered;
  {
    const std::lock_guard lock(mutex_);
    answered.swap(answered_);
  }
  for (JournalEntry& entry : answered)
    publish_in_journal(
        member_->broker(),
        pair_messages::announcement({.boot = boot_, .answered = true, .entry = std::move(entry)}));
  // An active agent publishes the results itself.
  if (!journal_ || !member_->is_up() || announcing_ != 0) return;
  auto left = journal_->next_unanswered(now);
  if (!left) return;
  pair_messages::Announcement announcement{
      .boot = boot_, .unanswered = true, .entry = std::move(*left)};
  announcement.id_is_number = parse_command(announcement.entry.payload).id_is_number;
  announcing_ = publish_in_journal(member_->broker(), pair_messages::announcement(announcement));
}

void PairMember::take_member_events(BootTime now) {
  member_->take_events(now, [&](const BrokerEvent& event) {
    const auto is_over = [&](std::uint64_t id) {
      if (id == farewell_) farewell_ = 0;
      if (id == announcing_) announcing_ = 0;
    };
    if (std::holds_alternative<Connected>(event)) {
      announcing_ = 0;
      if (journal_) journal_->connection_began();
    }
    if (const auto* message = std::get_if<Message>(&event)) hear(*message, now);
    if (const auto* done = std::get_if<Delivered>(&event)) is_over(done->id);
    if (const auto* failure = std::get_if<DeliveryFailed>(&event)) is_over(failure->id);
  });
}

void PairMember::hear(const Message& message, BootTime now) {
  const std::string base = config_.base_topic();
  if (const auto device = device_of(message.topic, base, "result")) {
    if (journal_) return journal_->keep_result(std::string(*device), message.payload);
    // This process was paused, so the other gateway may be active by now.
    if (now >= state_.holds_until()) save_heard(std::string(*device), message.payload);
    return;
  }
  const auto place = pair_messages::place_of(message.topic, base);
  if (!place) return;
  if (place->leaf.empty()) {
    const auto status = pair_messages::status_from(message.payload);
    if (!status || status->member != place->member) return;
    const std::lock_guard lock(mutex_);
    state_.heard(*status, now);
  } else if (place->leaf == "heartbeat") {
    const auto heartbeat = pair_messages::heartbeat_from(message.payload);
    if (!heartbeat) return;
    const std::lock_guard lock(mutex_);
    peers_.heard_heartbeat(place->member, heartbeat->boot, heartbeat->seq, now);
  } else if (auto announcement = pair_messages::announcement_from(message.payload)) {
    hear_announcement(std::move(*announcement), place->member, message.topic);
  }
}

void PairMember::hear_announcement(pair_messages::Announcement announcement,
                                   const std::string& member, const std::string& topic) {
  const bool is_of_this_process = announcement.boot == boot_;
  JournalEntry& entry = announcement.entry;
  if (announcement.mark != 0) {
    if (claim_ == Claim::marking && is_of_this_process && announcement.mark == mark_)
      claim_ = Claim::marked;
  } else if (!is_of_this_process && journal_) {
    if (announcement.answered) return journal_->keep_answered(entry);
    // Its own topic may still have announcements of the process before this one.
    if (!announcement.unanswered && member != pair_.member)
      return journal_->keep_announced(std::move(entry), topic);
    auto known = journal_->keep_unanswered(std::move(entry), topic);
    if (known && known->acknowledged) reply(std::move(*known));
  } else if (!announcement.unanswered) {
    // This process was paused, and the other gateway has become active.
    if (member != pair_.member && !announcement.answered)
      save_heard(topic, pair_messages::announcement(announcement));
  } else if (!is_of_this_process) {
    const std::lock_guard lock(mutex_);
    if (agent_ && !leaving_) agent_->take_unanswered(std::move(entry), topic);
  }
}

// ---- the lease session --------------------------------------------------------------------------

void PairMember::take_lease_events(BootTime now) {
  const auto take = [&](const auto& event) {
    using Event = std::remove_cvref_t<decltype(event)>;
    if constexpr (std::is_same_v<Event, Connected>) {
      window_ =
          std::clamp(event.receive_maximum, kForHeartbeats + 1, kMostOnTheWay) - kForHeartbeats;
      claim_ = Claim::none;
      // This round may have begun long before the broker accepted the session.
      state_.lease_began(boot_time_now());
    } else if constexpr (std::is_same_v<Event, ConnectFailed>) {
      log::warn("pair", {{"claim", "failed"}, {"reason", event.text}});
      lease_ended(false, now);
    } else if constexpr (std::is_same_v<Event, Lost>) {
      lease_ended(event.reason_code == kSessionTakenOver, now);
    } else if constexpr (std::is_same_v<Event, Disconnected>) {
      lease_ended(false, now);
    } else if constexpr (std::is_same_v<Event, Delivered>) {
      if (!announcements_.delivered(event.id)) state_.heartbeat_acknowledged(event.id);
    } else if constexpr (std::is_same_v<Event, DeliveryFailed>) {
      log::error("pair", {{"fault", "the broker refuses what this gateway publishes below " +
                                        topic() + ": " + event.text + "; see fxagent acl"}});
      announcements_.refused(event.id);
    }
  };
  for (const BrokerEvent& event : lease_->take_events()) std::visit(take, event);
}

void PairMember::lease_ended(bool taken_over, BootTime now) {
  permit_.revoke();
  window_ = 0;
  claim_ = Claim::none;
  const auto stops = [this] {
    const std::lock_guard lock(mutex_);
    return over_ = agent_ && agent_->is_stopping();
  };
  if (stops()) return;
  state_.lease_ended(taken_over, now);
  if (journal_) return;
  end_member_session();
  if (stops()) return;
  write_at_once(log::line(log::Level::warn, "pair",
                          {{"role", std::string(to_string(state_.role()))},
                           {"why", state_.why()},
                           {"member", pair_.member},
                           {"boot", boot_},
                           {"note", "the agent starts anew as the standby"}}));
  restart_program();
}

void PairMember::save_heard(const std::string& where, const std::string& text) {
  if (text.find('\n') != std::string::npos) return;  // not of a gateway
  if (!StandbyJournal::save_heard(config_.store, where, text))
    write_at_once(
        log::line(log::Level::error, "pair",
                  {{"fault", "what the other gateway sent about a command was not written to " +
                                 config_.store.path + ": repeat no command of the last minutes"}}));
}

/// Takes what the MQTT library has acknowledged: the broker does not send it to the next process.
/// That process may have to wait for a config without errors, so this gateway is offline until
/// then.
void PairMember::end_member_session() {
  take_member_events(boot_time_now());
  Broker& broker = member_->broker();
  if (!broker.is_connected()) return;
  const BootTime patience = boot_time_now() + kFarewell;
  const auto wait_while = [&](const auto& goes_on) {
    while (broker.is_connected() && goes_on() && boot_time_now() < patience) {
      std::unique_lock lock(mutex_);
      news_.wait_for(lock, kShortestWait, [this] { return woken_; });
      woken_ = false;
      lock.unlock();
      take_member_events(boot_time_now());
    }
  };
  farewell_ = publish(broker, offline_status());
  wait_while([this] { return farewell_ != 0; });
  broker.disconnect();
  wait_while([] { return true; });
  take_member_events(boot_time_now());
}

void PairMember::drop_lease(BootTime now) {
  // The end of a connection that is already broken may never be reported.
  lease_->disconnect();
  lease_ended(false, now);
}

void PairMember::take_evicting_events(BootTime now) {
  for (const BrokerEvent& event : evicting_->take_events()) {
    if (claim_ != Claim::evicting) continue;
    if (std::holds_alternative<ConnectFailed>(event)) {
      drop_lease(now);
    } else if (std::holds_alternative<Connected>(event)) {
      evicting_->disconnect();
      claim_ = Claim::marking;
      mark_ = publish_in_journal(*lease_,
                                 pair_messages::announcement({.boot = boot_, .mark = next_id_}));
    }
  }
}

/// The session of the agent ends that of the other gateway, so that nothing more of it is
/// published. Everything that it had published comes before the mark.
void PairMember::go_on_with_claim(BootTime now) {
  if (state_.role() != PairRole::claiming || !permit_.holds(now)) return;
  // A broker that refuses the mark, or a member session that is away: the other gateway may do
  // better.
  if (claim_ != Claim::claimed && now >= state_.opens_at() + kMostClaims * pair_.quiet)
    return drop_lease(now);
  if (claim_ == Claim::none) {
    claim_ = Claim::evicting;
    evicting_->connect(member_->server(), kReceiveMaximum);
  }
  if (claim_ != Claim::marked) return;
  claim_ = Claim::claimed;
  // Results that the other gateway published may not have come here.
  if (!member_->heard_all() && peers_.other_held_last()) journal_->acknowledge_own_commands();
  auto unwritten = journal_->close();
  journal_.reset();
  state_.has_claimed(boot_time_now());
  permit_.revoke();
  floor_ = std::max(static_cast<std::uint64_t>(utc_now_ms()), peers_.highest_seq());
  wake([&] { claimed_ = {floor_, std::move(unwritten)}; });
  // At once: the number shows the other gateway that this one has held the pair.
  carry_out(PairState::Action::send_heartbeat, now);
}

void PairMember::carry_out(PairState::Action action, BootTime now) {
  switch (action) {
    case PairState::Action::publish_status:
      return publish_status();
    case PairState::Action::connect_lease:
      return lease_->connect(member_->server(), kReceiveMaximum);
    case PairState::Action::drop_lease:
      return drop_lease(now);
    case PairState::Action::send_heartbeat: {
      std::uint64_t seq = peers_.highest_seq();
      if (floor_ != 0) {
        const std::lock_guard lock(mutex_);
        seq = std::max(agent_ ? agent_->highest_seq() : 0, floor_) + kReserve;
      }
      const std::string text = pair_messages::heartbeat({boot_, seq}, next_id_);
      return state_.heartbeat_sent(publish(*lease_, retained(topic("/heartbeat"), text)), now);
    }
  }
}

void PairMember::publish_status() {
  const auto age = std::chrono::round<milliseconds>(boot_time_now() - state_.since());
  const std::int64_t now_ms = utc_now_ms();
  const PairStatus status{.member = pair_.member,
                          .boot = boot_,
                          .role = std::string(to_string(state_.role())),
                          .is_third = peers_.is_third(),
                          .quiet = pair_.quiet,
                          .why = state_.why(),
                          .peer = peers_.peer(),
                          .since_ms = state_.since() == BootTime{} ? now_ms : now_ms - age.count()};
  publish(member_->broker(), retained(topic(), pair_messages::status(status)));
}

void PairMember::log_changes(BootTime now) {
  const std::string peer = peers_.peer();
  if (state_.role() != std::exchange(logged_, state_.role()))
    log::info("pair", {{"role", std::string(to_string(logged_))},
                       {"why", state_.why()},
                       {"member", pair_.member},
                       {"boot", boot_},
                       {"peer", peer}});
  if (logged_peer_ == peer || (peer.empty() && !peers_.has_listened(now))) return;
  logged_peer_ = peer;
  if (peer.empty())
    log::warn("pair", {{"peer", ""},
                       {"note", "the other gateway is away; if this one fails, none takes over"}});
  else
    log::info("pair", {{"peer", peer}});
}

}  // namespace fxagent
