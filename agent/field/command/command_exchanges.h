// Performs the exchanges of one command: each within its time, repeated only if the first one
// surely had no effect, and with turns for others in between. Records what was sent;
// CommandExecution makes the result of it. Field thread.
#pragma once

#include <asio/awaitable.hpp>
#include <asio/steady_timer.hpp>
#include <chrono>
#include <cstddef>
#include <optional>
#include <span>

#include "agent/commands/admitted_command.h"
#include "agent/config/model.h"
#include "agent/field/bus/bus.h"
#include "agent/handover/command_message.h"
#include "agent/steady_time.h"
#include "protocol/codec.h"
#include "protocol/plan/plan.h"

namespace fxagent {

/// PORT: the link, as a running command sees it.
class BusSharing {
 public:
  virtual ~BusSharing() = default;

  // ---- turns for others ----

  /// Lets polls and other commands run between two parts of a long command. `used` is the line time
  /// of the part that has just ended.
  virtual asio::awaitable<void> give_way(std::chrono::nanoseconds used) = 0;
  /// Lets the polls run that go first after a silence. True: one has run.
  virtual asio::awaitable<bool> give_way_after_silence() = 0;

  // ---- reports of the command ----

  /// Called when the device has left an exchange unanswered for this long.
  virtual void was_silent(std::chrono::nanoseconds lasted) = 0;
  /// Called when one frame has written all targets, or may have. No target has its outcome yet.
  virtual void written_together(const Exchange& exchange) = 0;
  /// Called when a target has its outcome, while others still wait.
  virtual void concluded(std::size_t target, const TargetResult& outcome) = 0;

  // ---- may the command go on? ----

  /// Returns why the command is stopping: shutting_down, reloading or conflict; none: it goes on. A
  /// stopping command writes nothing more. It may still read back what it has written.
  virtual Reason why_stopping() const = 0;
  bool is_stopping() const { return why_stopping() != Reason::none; }
  /// False if nothing at all may be sent any more, not even a read-back.
  virtual bool may_send() const = 0;
};

class CommandExchanges final {
 public:
  struct ReadBack {
    std::optional<Bytes> image;  ///< of the whole point; nullopt: it could not be read
    Exchange last;
  };

  /// Arguments as for CommandExecution.
  CommandExchanges(asio::any_io_executor executor, Bus& bus, Station& station,
                   const DeviceConfig& device, std::span<const Holes::Limit> limits,
                   const AdmittedCommand& admitted, BusSharing& sharing);

  /// The effect that an exchange is meant to have on the device.
  enum class Effect : std::uint8_t { none, change };

  /// Performs one exchange; sends nothing after `not_after`. Opens the channel if it is closed.
  /// Before the first exchange that is to change something, marks the command as started. After an
  /// unanswered exchange, lets polls run first.
  asio::awaitable<Exchange> ask(Request request, SteadyTime not_after,
                                Effect effect = Effect::none);
  /// Reads the whole point of the target, each exchange within latest_start(). Repeats each failed
  /// read as the config says.
  asio::awaitable<ReadBack> read_point(const AdmittedTarget& target);
  /// Sends a write, and a second time only if the first surely had no effect.
  asio::awaitable<Exchange> send_once_or_twice(Request request, bool may_repeat);
  /// Gives others their turn if `share` is true. False: the command is to stop.
  asio::awaitable<bool> go_on(bool share);
  asio::awaitable<void> pause(std::chrono::milliseconds duration);

  /// Returns the latest time at which an exchange may begin. Unlimited once a write was sent, by
  /// this run or an earlier one, because such a command is finished.
  SteadyTime latest_start() const;
  bool is_stopping() const { return sharing_.is_stopping(); }
  /// True if the disk did not answer when the command was to be marked. Nothing was written.
  bool is_unmarked() const { return is_unmarked_; }
  /// True if why_stopping() came before an answer, or before anything was sent.
  bool was_cut_off() const { return cut_off_; }

  /// Returns the number of writes sent.
  int writes() const { return writes_; }
  /// Times of the first byte of the first exchange and of the end of the last one.
  std::optional<SteadyTime> first_byte() const { return first_byte_; }
  SteadyTime last_byte() const { return last_byte_; }
  /// Returns the line time since others last had their turn.
  std::chrono::nanoseconds used() const;
  /// Returns BusDoubt::findings(): how often foreign bytes were found on the bus.
  std::uint64_t findings() const { return bus_.doubt().findings(); }
  /// True if the device has answered something, or has left something unanswered.
  bool was_answered() const { return answered_; }
  bool was_unanswered() const { return unanswered_; }

 private:
  enum class Try : std::uint8_t { first, second };
  /// Sends `request`, after the read that it needs, if any. If that read fails, the command fails
  /// with it.
  asio::awaitable<Exchange> send(Request request, Try which);
  /// Records that why_stopping() ends the command. Returns the exchange that is not sent.
  Exchange cut_off();
  /// Marks the command as started, once. False: it could not be marked and must not be sent.
  asio::awaitable<bool> mark_started();
  /// True if a gateway refused, because the device behind it does not answer.
  bool is_of_gateway(const Exchange& exchange) const;
  /// Adds the settings to check to the error, if the device never answered.
  void add_hint(Exchange& exchange) const;

  asio::steady_timer timer_;
  Bus& bus_;
  Station& station_;
  const DeviceConfig& device_;
  std::span<const Holes::Limit> limits_;
  const AdmittedCommand& admitted_;
  BusSharing& sharing_;
  std::optional<SteadyTime> first_byte_;
  /// Start of the silence before the first byte since others last had their turn.
  std::optional<SteadyTime> part_began_;
  SteadyTime last_byte_{};
  int writes_ = 0;
  bool is_started_ = false;
  bool is_unmarked_ = false;
  bool cut_off_ = false;
  bool answered_ = false;
  bool unanswered_ = false;
  bool was_silent_ = false;  ///< the last exchange went unanswered
};

}  // namespace fxagent
