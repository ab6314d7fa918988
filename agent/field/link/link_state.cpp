#include "agent/field/link/link_state.h"

#include <algorithm>
#include <array>
#include <utility>
#include <variant>

#include "agent/field/bus/unexpected_bytes.h"
#include "agent/log/log.h"

namespace fxagent {
namespace {

using std::chrono::milliseconds;
using std::chrono::nanoseconds;
using Clock = std::chrono::steady_clock;

// Opening a serial path costs nothing. A host that is away must not be flooded with attempts, and
// all its clients must not connect at once when it returns.
constexpr ReconnectRules kSerialReconnects{milliseconds(500), milliseconds(2000), milliseconds(0)};
constexpr ReconnectRules kTcpReconnects{milliseconds(500), milliseconds(30000), milliseconds(200)};
// A peer that accepts each connection and closes it without an answer has no free place. The next
// attempt waits at least this long.
constexpr milliseconds kAfterRefusal{1000};
// After this many consecutive unanswered exchanges on TCP and UDP, with any device, the peer is
// gone or its name has another address.
constexpr int kDeadPeerAfter = 3;

// A device that comes and goes has its groups read at once at most this often. If it is silent to
// some reads and answers others, it would otherwise keep the line from all others.
constexpr std::chrono::seconds kAtOnceEvery{10};

// A recurring doubt is logged at most this often; each one is counted.
constexpr std::chrono::seconds kDoubtLoggedEvery{60};

/// Returns the name of a bad tag, the reason and what to do.
std::string text_of(const TagConfig& tag, BadReason why) {
  constexpr auto kTexts = std::to_array<std::string_view>(
      {"its last read was not answered",
       "the device refuses to read it, for a reason in the log; does the device have the address?",
       "its last answers were damaged; look for noise, a wrong parity or a second master",
       "the line was lost during its last read",
       "the model lacks the address, or is not known yet, or the place has another name on this "
       "PLC; set or correct model, or correct the address",
       "its bytes are no valid value of its type; correct type or word_order"});
  static_assert(kTexts.size() == static_cast<std::size_t>(BadReason::bad_value) + 1);
  return "tag " + std::string(tag.name) + " at " + std::string(tag.point.address.text) + ": " +
         std::string(kTexts[static_cast<std::size_t>(why)]);
}

/// Returns another seed for each link, each start and each machine.
std::uint64_t jitter_seed(std::uint32_t link) {
  return static_cast<std::uint64_t>(std::chrono::system_clock::now().time_since_epoch().count()) +
         link;
}

bool is_serial(const LinkConfig& link) {
  return std::holds_alternative<SerialSettings>(link.channel);
}

ReconnectRules opening_rules(const LinkConfig& link) {
  return is_serial(link) ? kSerialReconnects : kTcpReconnects;
}

/// True if any device can answer, that is, not all are broadcasts.
bool is_asked(const LinkDevices& devices) {
  return std::ranges::any_of(devices,
                             [](const auto& device) { return !device->codec->is_broadcast(); });
}

/// Returns what to check if the peer has closed the connection.
std::string checklist_of_closed(const LinkDevices& devices) {
  if (devices.empty() || devices.front()->config.protocol == nullptr) return {};
  const LinkDevice& first = *devices.front();
  return std::string(fxagent::checklist_of_closed(*first.config.protocol, *first.codec));
}

/// Logs the state of a link or a device, which `what` says. `note`: empty if there is none.
void log_state(decltype(&log::info) write, const char* what, const std::string& name,
               std::string_view state, const std::string& reason, const std::string& note) {
  const log::Field subject(what, name);
  if (note.empty())
    write(what, {subject, {"state", std::string(state)}, {"reason", reason}});
  else
    write(what, {subject, {"state", std::string(state)}, {"reason", reason}, {"note", note}});
}

/// True if the peer closed or refused the channel before any answer. That counts as a failed
/// attempt.
bool is_refused(const LinkParts& link) {
  return !is_serial(link.config) && link.bus.channel().closed_unanswered() &&
         is_asked(link.devices);
}

/// A device that has never answered is reported at once: its settings may be wrong, and on MC
/// `retries` + 1 timeouts are 15 s.
bool is_silent(const LinkParts& link, const LinkDevice& device) {
  const PolledDevice& polled = link.scheduler.device(device.id);
  const bool never_answered = polled.unanswered_in_a_row() > 0 && !device.state.has_answered();
  return never_answered || polled.is_silent();
}

/// `unanswered_in_a_row`: consecutive unanswered exchanges with any device of the link.
std::string why_silent(const LinkParts& link, const LinkDevice& device, int unanswered_in_a_row) {
  const auto why = [&](Answers answers) {
    return checklist_of(device.config, *device.codec, device.station.wiring, answers);
  };
  if (!device.gateway_says.empty())
    return "\"" + device.gateway_says + "\": " + why(Answers::of_gateway);
  if (device.state.has_answered()) {
    const int own = link.scheduler.device(device.id).unanswered_in_a_row();
    const bool others_answer = std::ranges::any_of(link.devices, [&](const auto& other) {
      return other.get() != &device && other->state.has_answered() &&
             link.scheduler.device(other->id).unanswered_in_a_row() == 0;
    });
    return why(others_answer && unanswered_in_a_row < own ? Answers::others_now
                                                          : Answers::until_now);
  }
  const bool others_answer = std::ranges::any_of(
      link.devices, [](const auto& other) { return other->state.has_answered(); });
  return why(others_answer ? Answers::from_others : Answers::none);
}

/// Reads every group of the device at `from` or later, but at most every kAtOnceEvery. A device or
/// link that comes and goes would otherwise occupy the line, or break it once more. Returns when
/// the next device may begin.
SteadyTime read_at_once(const LinkParts& link, LinkDevice& device, SteadyTime from) {
  const bool is_planned = device.at_once_from - kAtOnceEvery > from;
  if (is_planned) return from;
  from = std::max(from, device.at_once_from);
  device.at_once_from = from + kAtOnceEvery;
  return link.scheduler.read_at_once(device.id, from);
}

/// Returns what the last unexpected bytes look like; empty: unknown.
std::string look_of_unexpected(const LinkDevices& devices, const Bus& bus) {
  if (devices.empty()) return {};
  const LinkDevice& device = *devices.front();
  const UnexpectedBytes guess =
      looks_like(device.config, *device.codec, ByteView(), bus.last_unexpected());
  return guess.cause == UnexpectedBytes::Cause::unknown ? "" : "; they look like " + guess.text;
}

}  // namespace

void BusLog::log_news() {
  if (link_.bus.echo_found() && !echo_logged_) {
    echo_logged_ = true;
    log::warn("link", {{"link", link_.config.name},
                       {"echo", "found"},
                       {"note",
                        "set echo for its devices: until three reads have shown the echo, the echo "
                        "of a command may pass for its answer"}});
  }
  if (!unexpected_logged_ && !link_.bus.last_unexpected().empty()) {
    unexpected_logged_ = true;
    log::warn("link", {{"link", link_.config.name},
                       {"unexpected", link_.bus.unexpected_text()},
                       {"note", "unexpected bytes; health counts them from now on" +
                                    look_of_unexpected(link_.devices, link_.bus)}});
  }
  const bool doubted = link_.bus.doubt().is_doubted();
  if (doubted == doubt_logged_) return;
  const auto now = Clock::now();
  if (doubted && doubt_logged_at_ && now - *doubt_logged_at_ < kDoubtLoggedEvery) return;
  doubt_logged_ = doubted;
  if (doubted) {
    doubt_logged_at_ = now;
    log::warn("link", {{"link", link_.config.name},
                       {"state", "doubted"},
                       {"unexpected", link_.bus.unexpected_text()},
                       {"note",
                        "another master, or late answers? Until several exchanges in a row are "
                        "clean, values are bad_frame and no ACK counts"}});
  } else {
    log::info("link", {{"link", link_.config.name}, {"state", "believed again"}});
  }
}

LinkState::LinkState(const LinkParts& link, std::size_t links)
    : link_(link),
      links_(links),
      reconnect_policy_(opening_rules(link.config), jitter_seed(link.index)) {}

nanoseconds LinkState::begin(SteadyTime now, milliseconds spread) {
  const LinkStart start = reconnect_policy_.start(links_, spread);
  next_open_ = now + start.open_after;
  return start.poll_after - start.open_after;
}

void LinkState::opened() {
  if (!link_.bus.is_open() || was_open_) return;
  // A peer that babbles, or closes what it accepts, accepts every connection. It is back when it
  // has answered.
  if (!link_.bus.channel().never_silent() && !peer_refused_) reconnect_policy_.opened();
  was_open_ = true;
  // A UDP port opens even if nothing is there.
  if (link_.bus.channel().transport().has_datagrams() && is_asked(link_.devices))
    up_awaits_answer_ = true;
  if (!up_awaits_answer_) log_up_once();
  SteadyTime from = Clock::now();
  for (const auto& device : link_.devices) {
    if (was_ever_down_) from = read_at_once(link_, *device, from);
    if (device->codec->is_broadcast()) update(*device);  // it has no answers that would do this
  }
}

void LinkState::log_up_once() {
  logged_up_ = true;
  log::info("link", {{"link", link_.config.name}, {"state", "up"}});
}

void LinkState::open_failed(const std::string& why) {
  next_open_ = Clock::now() +
               reconnect_policy_.after_failure(is_refused(link_) ? kAfterRefusal : milliseconds(0));
  was_open_ = false;  // it may have been closed after a silence
  lost(why);
}

void LinkState::lost(const std::string& why) {
  closed_as_dead_ = false;
  peer_refused_ = is_refused(link_);
  if (was_open_ && peer_refused_)
    next_open_ = Clock::now() + reconnect_policy_.after_failure(kAfterRefusal);
  else if (was_open_)
    next_open_ =
        Clock::now() + (link_.bus.channel().never_silent() ? reconnect_policy_.after_failure()
                                                           : reconnect_policy_.after_loss());
  const bool is_closed = peer_refused_ && !link_.bus.channel().transport().has_datagrams();
  if (is_closed)
    go_down(why + " before its first answer", checklist_of_closed(link_.devices));
  else
    go_down(why, {});
}

void LinkState::go_down(std::string why, const std::string& note) {
  if (logged_up_ || why != why_down_)
    log_state(log::warn, "link", link_.config.name, "down", why, note);
  up_awaits_answer_ = !is_serial(link_.config) &&
                      (peer_refused_ || (was_open_ && !link_.bus.channel().was_answered() &&
                                         is_asked(link_.devices)));
  logged_up_ = was_open_ = false;
  was_ever_down_ = true;
  why_down_text_ = note.empty() ? why : why + ": " + note;
  why_down_ = std::move(why);
  all_fell_silent();
}

void LinkState::all_fell_silent() {
  for (const auto& device : link_.devices) {
    device->state.fell_silent();
    update(*device);
  }
}

void LinkState::yielded(const std::string& text) {
  if (std::exchange(yielded_, text) == text) return;
  was_open_ = closed_as_dead_ = false;
  log::info("link", {{"link", link_.config.name}, {"state", "yielded"}, {"note", text}});
  all_fell_silent();
}

void LinkState::taken_back() {
  yielded_.clear();
  was_ever_down_ = true;  // all is read at once when it is open
  next_open_ = Clock::now();
  log::info("link", {{"link", link_.config.name}, {"state", "taken_back"}});
}

void LinkState::check_bus() {
  if (link_.bus.channel().closed_after_silence() && was_open_)
    next_open_ = Clock::now();
  else if (!link_.bus.is_open() && was_open_)
    lost(link_.bus.channel().why_lost());
}

bool LinkState::exchanged(LinkDevice& device, const Exchange& exchange) {
  device.log_foreign_bytes(exchange);
  const bool by_gateway =
      exchange.is_nak() && device.codec->is_from_gateway(exchange.reply.device_code);
  if (by_gateway)
    unreachable(device, exchange.reply.text, exchange.line_time());
  else if (exchange.has_answer())
    answered(device);
  else if (exchange.outcome == Exchange::Outcome::unanswered)
    unanswered(device);
  else if (exchange.outcome == Exchange::Outcome::link_down)
    lost(exchange.error);
  return exchange.has_answer() && !by_gateway;
}

void LinkState::answered(LinkDevice& device) {
  unanswered_in_a_row_ = 0;
  if (std::exchange(up_awaits_answer_, false) && was_open_) log_up_once();
  if (!link_.bus.channel().never_silent()) reconnect_policy_.opened();
  device.state.answered();
  device.gateway_says.clear();
  PolledDevice& polled = link_.scheduler.device(device.id);
  const bool is_back = polled.is_silent();
  polled.answered();
  if (!is_back) return;
  read_at_once(link_, device, Clock::now());
}

void LinkState::unreachable(LinkDevice& device, const std::string& reason, nanoseconds lasted) {
  device.log_refusal_once(reason);
  unanswered_in_a_row_ = 0;
  device.gateway_says = reason;
  link_.scheduler.was_silent(device.id, lasted);
  link_.scheduler.device(device.id).unanswered(Clock::now());
}

void LinkState::unanswered(LinkDevice& device, PolledDevice::AskedBy by) {
  device.gateway_says.clear();
  // A command has reported each of its silences.
  if (by == PolledDevice::AskedBy::poll)
    link_.scheduler.was_silent(device.id, device.station.timeout);
  const bool silent = link_.scheduler.device(device.id).unanswered(Clock::now(), by);
  if (silent) device.state.fell_silent();
  const int limit = std::max(kDeadPeerAfter, static_cast<int>(link_.devices.size()) + 1);
  if (++unanswered_in_a_row_ < limit || is_serial(link_.config) || !was_open_) return;
  link_.bus.close();
  peer_refused_ = false;
  closed_as_dead_ = true;
  next_open_ = Clock::now() + reconnect_policy_.after_loss();
  go_down(link_.bus.channel().transport().has_datagrams() ? "no answers on this UDP port"
                                                          : "no answers on this connection",
          {});
}

void LinkState::update(LinkDevice& device) {
  if (!was_open_ && why_down_.empty() && !is_yielded()) return;
  DeviceState::Facts facts;
  facts.yielded = yielded_;
  facts.silent = is_silent(link_, device);
  const bool opens_again = was_open_ && link_.bus.channel().closed_after_silence();
  facts.bus_open = link_.bus.is_open() || opens_again || (closed_as_dead_ && facts.silent);
  facts.never_silent = link_.bus.channel().never_silent();
  if (!facts.bus_open)
    facts.why_offline = why_down_text_;
  else if (facts.silent)
    facts.why_offline = why_silent(link_, device, unanswered_in_a_row_);
  for (const auto& group : device.groups) {
    const auto bad = group->cycle.first_bad();
    if (!bad) continue;
    facts.first_bad = bad->why;
    facts.bad_tag = text_of(device.config.tags[bad->tag], bad->why);
    break;
  }
  const auto change = device.state.update(facts, utc_now_ms());
  if (!change) return;
  DeviceStatus status = change->status;
  const auto write = status.state == DeviceStatus::State::offline ? log::warn : log::info;
  if (change->other_state)
    log_state(write, "device", device.config.name, to_string(status.state), status.reason,
              status.reason_text);
  status.codec = device.codec;
  status.codec_of_plc = device.codec_of_plc;
  link_.outbox.push(std::move(status));
}

}  // namespace fxagent
