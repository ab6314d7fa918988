// The loop of one link: opens the bus and runs Poller and LinkCommands in the sequence that the
// PollScheduler gives. One coroutine. Field thread.
#pragma once

#include <asio/any_io_executor.hpp>
#include <asio/awaitable.hpp>
#include <asio/steady_timer.hpp>
#include <atomic>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "agent/commands/admitted_command.h"
#include "agent/config/model.h"
#include "agent/field/bus/bus.h"
#include "agent/field/command/link_commands.h"
#include "agent/field/field.h"
#include "agent/field/link/link_device.h"
#include "agent/field/link/link_recorder.h"
#include "agent/field/link/link_state.h"
#include "agent/field/link/poller.h"
#include "agent/field/poll/poll_scheduler.h"
#include "agent/handover/command_message.h"
#include "agent/handover/field_health.h"
#include "agent/handover/outbox.h"

namespace fxagent {

/// Returns for each link the indices of its devices in Config::devices.
std::vector<std::vector<std::uint32_t>> devices_by_link(const Config& config);

class LinkWorker final {
 public:
  /// `outbox` and the devices of `config` must outlive the worker. `link` is an index in
  /// Config::links; `devices` is its entry of devices_by_link(). `last_seq` has the newest sequence
  /// number of each device; a missing entry counts as 0. `recorder` must outlive the worker;
  /// nullptr: frames are not recorded.
  LinkWorker(asio::any_io_executor executor, const Config& config, std::uint32_t link,
             std::span<const std::uint32_t> devices, Outbox& outbox,
             std::unique_ptr<Transport> transport, std::span<const std::uint64_t> last_seq,
             Polling polling, FlightRecorder* recorder = nullptr);
  LinkWorker(const LinkWorker&) = delete;
  LinkWorker& operator=(const LinkWorker&) = delete;

  /// Makes the next sequence number of the device higher than `seq`.
  void number_above(std::uint32_t device, std::uint64_t seq);

  /// Runs until stop(), then answers the waiting commands and returns.
  asio::awaitable<void> run();

  /// Queues a command for a device of this link. Its result, whatever it is, goes to the outbox.
  void submit(AdmittedCommand admitted);

  /// Adds devices of `config` to the link, open or not.
  void add(const Config& config, std::span<const std::uint32_t> devices,
           std::span<const std::uint64_t> last_seq);
  /// Removes devices from the link without disturbing the others. Their waiting commands get FAILED
  /// reloading. A running command writes nothing more: its exchange on the wire ends, and its
  /// read-back has kFinishWithin. `left` is called with them when all their results are in the
  /// outbox: at once, or after the exchange on the wire.
  void remove(std::span<const std::uint32_t> devices, std::function<void(LinkDevices)> left);
  /// Applies poll_share, listening and allow_yield of `link`. A yield no longer allowed ends.
  void adjust(const LinkConfig& link);
  /// Applies interval, publish and max_silent of the groups of `device`, which has this index.
  void adjust(std::uint32_t index, const DeviceConfig& device);
  /// Final once run() has ended.
  const LinkDevices& devices() const { return devices_; }

  /// Receives the outcome of a yield() or take_back(): Reason::none if it was done.
  using Done = std::function<void(Reason)>;
  /// Closes the port for another program as soon as nothing is on the wire, until `until`. Commands
  /// that wait or come then get REJECTED yielded. `text` says who wanted it and until when.
  void yield(SteadyTime until, std::string text, Done done);
  /// Ends the yield at once.
  void take_back(Done done);

  /// Ends run(), soon after kFinishWithin at the latest: cuts a poll short and answers waiting
  /// commands with FAILED `why`, which is shutting_down or reloading. A running command writes
  /// nothing more; its exchange on the wire and its read-back have kFinishWithin.
  void stop(Reason why = Reason::shutting_down);
  /// True once run() has ended. Any thread.
  bool has_ended() const { return ended_; }

  /// Switches the log of each frame on or off.
  void trace(bool on);
  bool is_traced() const { return bus_.is_traced(); }

  /// Adds the counters of this link and its devices to `health`.
  void report(FieldHealth& health);

 private:
  struct Leave {
    std::vector<std::uint32_t> devices;
    std::function<void(LinkDevices)> left;
  };

  LinkDevice& add_device(const Config& config, std::uint32_t index,
                         std::span<const std::uint64_t> last_seq);
  void begin_polls(LinkDevice& device);
  /// Removes the devices that leave. Call only while nothing is on the wire.
  void let_leave();

  asio::awaitable<void> serve();
  /// Leaves the port to another program for the time of the yield.
  asio::awaitable<void> be_away();
  void answer_yields(Reason why);

  asio::awaitable<void> open_line();

  const LinkConfig config_;  ///< as at its beginning: adjust() does not change it
  const Polling polling_;
  Bus bus_;
  LinkRecorder recorder_;
  PollScheduler scheduler_;
  LinkDevices devices_;
  const LinkParts parts_;
  LinkState state_;
  BusLog bus_log_{parts_};
  Poller poller_;
  LinkCommands commands_;
  asio::steady_timer idle_;
  std::chrono::nanoseconds polls_begun_{0};  ///< line time of one cycle of each group added so far
  SteadyTime counting_since_{};
  std::optional<double> busy_percent_;              ///< of the last complete window
  std::unique_ptr<asio::steady_timer> stop_timer_;  ///< set by stop()
  bool on_the_wire_ = false;  ///< a command or a poll is running: no device may leave
  std::vector<Leave> leaves_;
  /// End of the yield; nullopt: none. If it has passed, the port is taken back next.
  std::optional<SteadyTime> yields_until_;
  std::string yield_text_;
  std::vector<Done> yields_done_;  ///< not called yet
  std::atomic<bool> ended_ = false;
};

}  // namespace fxagent
