// The field room as a whole: its thread, its links. Everything else in here runs on that thread.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "agent/commands/admitted_command.h"
#include "agent/config/config.h"
#include "agent/config/config_difference.h"
#include "agent/messages.h"
#include "agent/outbox.h"

namespace fxagent {

/// Off: devices answer commands only, as the command line wants it.
enum class Polling : std::uint8_t { on, off };

class Field final {
 public:
  using Done = std::function<void()>;

  /// `outbox` outlives the field, which keeps a copy of `config`. Nothing runs yet. `last_seq`: of
  /// each device the number of its newest sample; missing ones: 0.
  Field(const Config& config, Outbox& outbox, const std::vector<std::uint64_t>& last_seq,
        Polling polling = Polling::on);
  /// Stops, if stop() was not called.
  ~Field();

  /// Before start(): each frame of these links, by index in Config::links, is logged.
  void trace(const std::vector<std::uint32_t>& links);
  /// Before start(): this signal switches the traces of all links, off where one is traced, else
  /// on. Its handler is asio's from then on.
  void switch_traces_at(int signal);
  /// Starts the thread. Throws std::system_error where there is none.
  void start();
  /// Numbers of samples go on above these, by device. Any thread.
  void number_above(std::vector<std::uint64_t> last_seq);
  /// Hands a command to the field; exactly one result comes back through the outbox. Any thread.
  void submit(AdmittedCommand admitted);
  /// Puts the counters of this moment into the outbox soon, beside those that come every 5 s. Any
  /// thread.
  void report();
  /// Calls `answer` on the field's thread, when its turn comes. Any thread.
  void ask(std::function<void()> answer);
  // A changed config, in two calls; any thread. What goes on does not notice.
  /// Ends what ends in the change: of a link or device what is on the wire has 2.5 s; on a link
  /// that goes on as long as the exchange takes. Commands that wait are FAILED shutting_down, and
  /// so is what comes for these devices until begin(). `done` is called on the field's thread when
  /// everything that they made is in the outbox, counters included; not where a stop() comes first.
  void end(std::shared_ptr<const ConfigChange> change, Done done);
  /// After end(): the new config, and what begins in the change. `last_seq` as in the constructor;
  /// of a device that had this name before in this run the numbers go on by themselves. `done` as
  /// above, when all has begun; commands are taken at once.
  void begin(std::shared_ptr<const ConfigChange> change, std::vector<std::uint64_t> last_seq,
             Done done);

  /// Stops polling, ends the command on each wire within 3 s, answers the waiting ones with FAILED
  /// shutting_down, and joins the thread. After it the outbox holds every result.
  void stop();
  /// The links that have not ended, of many the first ones. Any thread, while stop() waits.
  std::string unfinished() const;

 private:
  class Room;
  std::unique_ptr<Room> room_;
};

}  // namespace fxagent
