// Whether a link is up, when it is opened next, and who answers on it. Tells of it in the log and
// in the states of the devices. Polls and commands report here how each exchange went. Field
// thread.
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "agent/config/config.h"
#include "agent/field/bus.h"
#include "agent/field/link_device.h"
#include "agent/field/poll_scheduler.h"
#include "agent/field/reconnect_policy.h"
#include "agent/messages.h"
#include "agent/outbox.h"

namespace fxagent {

class LinkState final {
 public:
  /// All references outlive it. `number` is the link's own among `links`. The bus is closed;
  /// `devices` may still be filled.
  LinkState(const LinkConfig& link, std::uint32_t number, std::size_t links, Bus& bus,
            PollScheduler& scheduler, const LinkDevices& devices, Outbox& outbox);

  /// When to open for the first time. Returns how long after that the polls begin, spread over
  /// `spread` with those of the other links.
  std::chrono::nanoseconds begin(SteadyTime now, std::chrono::milliseconds spread);
  /// While the bus is closed it is not to be opened before.
  SteadyTime next_open() const { return next_open_; }

  /// The bus may have been opened: if so, and if that is news, the link is up.
  void opened();
  /// It could not be opened.
  void open_failed(const std::string& why);
  /// It is closed. The next attempt has its time, that of a vain one where the peer closed it
  /// before its first answer; every device is offline.
  void lost(const std::string& why);
  /// Tells what the bus has noticed by itself: a loss, an echo, bytes that nobody asked for, and
  /// that it is doubted or believed again. Where it was closed behind a silence, it is no loss, and
  /// to be opened at once.
  void look();

  /// The device has answered something, if only with a refusal.
  void answered(LinkDevice& device);
  /// It has left a question unanswered. Where nobody answers on a TCP connection or UDP port any
  /// more, this closes it.
  void unanswered(LinkDevice& device, PollScheduler::AskedBy by = PollScheduler::AskedBy::poll);
  /// Bytes came in place of the answer of an exchange: the log shows the first of them and what
  /// they look like, once a day for each device and cause.
  void heard_foreign(LinkDevice& device, const Exchange& exchange);
  /// A gateway answered `reason` in its place: the device is silent, the connection is not.
  void unreachable(LinkDevice& device, const std::string& reason);
  /// Tells the state of the device where it is another one now.
  void update(LinkDevice& device);

  /// The agent, or this link, is to stop: nothing new begins. `why` is for people, and a constant.
  void stop(std::string_view why) { why_stopping_ = why; }
  bool is_stopping() const { return !why_stopping_.empty(); }
  std::string_view why_stopping() const { return why_stopping_; }

 private:
  /// Closed by its peer, or refused, before anybody answered: no better than one that did not open.
  bool is_refused() const;
  /// Whether any of its devices ever answers.
  bool is_asked() const;
  std::string_view checklist_of_closed() const;
  bool is_silent(const LinkDevice& device) const;
  std::string why_silent(const LinkDevice& device) const;
  void tell_up();
  void go_down(std::string why, std::string_view note);
  void log_doubt();
  /// What they look like; empty: nothing is known.
  std::string what_nobody_asked_for() const;
  SteadyTime read_at_once(LinkDevice& device, SteadyTime from);

  const LinkConfig& config_;
  const std::size_t links_;
  Bus& bus_;
  PollScheduler& scheduler_;
  const LinkDevices& devices_;
  Outbox& outbox_;
  ReconnectPolicy reconnect_policy_;
  SteadyTime next_open_{};
  std::string why_down_ = "not opened yet";
  std::string why_down_text_ = why_down_;  ///< the same with what to check
  bool was_open_ = false;                  ///< and is, but for a moment behind a silence
  /// Closed because nobody answers: a device that is silent is so whether or not it is open.
  bool is_left_ = false;
  bool was_down_ = false;  ///< not only not yet open
  /// The log says so. After a session without an answer the next one is up when it has one.
  bool is_told_up_ = false;
  bool is_vain_ = false;      ///< the session before had no answer
  bool was_refused_ = false;  ///< and it was its peer who ended it
  bool echo_logged_ = false;
  bool unexpected_logged_ = false;
  bool doubt_logged_ = false;
  std::optional<SteadyTime> doubt_logged_at_;
  int unanswered_in_a_row_ = 0;
  std::string_view why_stopping_;  ///< empty: it is not
};

}  // namespace fxagent
