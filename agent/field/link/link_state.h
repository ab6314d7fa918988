// Tracks whether a link is up, when it is opened next, and which devices answer. Logs changes and
// publishes the states of the devices. Polls and commands report here how each exchange went.
// BusLog logs what the bus has found. Field thread.
#pragma once

#include <chrono>
#include <optional>
#include <string>
#include <string_view>

#include "agent/field/link/link_device.h"
#include "agent/field/link/reconnect_policy.h"
#include "agent/field/poll/poll_scheduler.h"
#include "agent/handover/command_message.h"
#include "agent/steady_time.h"

namespace fxagent {

/// Logs what the bus of a link has found besides answers: an echo, unexpected bytes, a doubt.
class BusLog final {
 public:
  explicit BusLog(const LinkParts& link) : link_(link) {}

  /// Logs what is new since the last call: an echo and unexpected bytes once, the beginning and end
  /// of a doubt at most once a minute.
  void log_news();

 private:
  const LinkParts link_;
  bool echo_logged_ = false;
  bool unexpected_logged_ = false;
  bool doubt_logged_ = false;
  std::optional<SteadyTime> doubt_logged_at_;
};

/// A link is up while its bus is open, or is reopened after a silence. On UDP, and after a session
/// without an answer, a device must have answered as well.
class LinkState final {
 public:
  /// The bus must be closed; `links` is the number of links.
  LinkState(const LinkParts& link, std::size_t links);

  /// Sets the time of the first open. Returns how long after it the polls begin, spread over
  /// `spread` with those of the other links.
  std::chrono::nanoseconds begin(SteadyTime now, std::chrono::milliseconds spread);
  /// Returns the earliest time to open the closed bus.
  SteadyTime next_open() const { return next_open_; }

  /// Call when the bus may have been opened. Marks the link as up, unless that awaits an answer.
  void opened();
  /// Records that the bus could not be opened.
  void open_failed(const std::string& why);
  /// Records that the bus was closed, and takes every device offline. Sets the time of the next
  /// attempt; if the peer closed the bus before its first answer, the delay is that of a failed
  /// attempt.
  void lost(const std::string& why);
  /// Handles a loss that the bus has noticed. If the bus was closed after a silence, this is not a
  /// loss, and it is reopened at once.
  void check_bus();

  /// Records that the bus was closed for another program. `text` says until when. What follows is
  /// no fault, until taken_back().
  void yielded(const std::string& text);
  /// The bus may be opened again, at once.
  void taken_back();
  bool is_yielded() const { return !yielded_.empty(); }

  /// True if the log reports the link as up.
  bool is_up() const { return logged_up_; }
  /// Returns why it went down last.
  const std::string& why_down() const { return why_down_; }

  /// Records how an exchange with the device has ended: calls answered(), unanswered(),
  /// unreachable() or lost(). Logs its foreign bytes. True: the device has answered, not a gateway.
  bool exchanged(LinkDevice& device, const Exchange& exchange);
  /// Records an answer of the device, even a refusal.
  void answered(LinkDevice& device);
  /// Records a request that the device left unanswered. Closes a TCP connection or UDP port on
  /// which no device answers any more.
  void unanswered(LinkDevice& device, PolledDevice::AskedBy by = PolledDevice::AskedBy::poll);
  /// Records that a gateway answered `reason` in place of the device: the device is silent, the
  /// connection is not. Logs each reason once until the device is online. `lasted`: the line time
  /// of the exchange.
  void unreachable(LinkDevice& device, const std::string& reason, std::chrono::nanoseconds lasted);
  /// Publishes the state of the device if it has changed. Until the first attempt to open the link
  /// has ended, the device is `starting`.
  void update(LinkDevice& device);

  /// Marks the link as stopping: nothing new begins. Commands that are not sent any more get `why`.
  void stop(Reason why) { why_stopping_ = why; }
  bool is_stopping() const { return why_stopping_ != Reason::none; }
  Reason why_stopping() const { return why_stopping_; }

 private:
  void log_up_once();
  void go_down(std::string why, const std::string& note);
  void all_fell_silent();

  const LinkParts link_;
  const std::size_t links_;
  ReconnectPolicy reconnect_policy_;
  SteadyTime next_open_{};
  std::string why_down_;
  std::string why_down_text_;  ///< same, with what to check
  bool was_open_ = false;      ///< also while it is reopened after a silence
  /// Closed because no device answers. A silent device then counts as silent, whether or not the
  /// bus is open.
  bool closed_as_dead_ = false;
  bool was_ever_down_ = false;     ///< was lost, failed to open or was taken back
  bool logged_up_ = false;         ///< the log reports the link as up
  bool up_awaits_answer_ = false;  ///< when open, it is reported as up after its first answer
  bool peer_refused_ = false;      ///< the peer ended the last attempt or session unanswered
  int unanswered_in_a_row_ = 0;
  std::string yielded_;                 ///< empty: the port is ours
  Reason why_stopping_ = Reason::none;  ///< none: not stopping
};

}  // namespace fxagent
