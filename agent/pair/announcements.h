// The commands of the active gateway on their way to the other one. A command is sent to its PLC
// only when the broker has its announcement, so that the other gateway never repeats it.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <list>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include "agent/commands/admitted_command.h"
#include "agent/steady_time.h"

namespace fxagent {

class Announcements final {
 public:
  using Submit = std::function<void(AdmittedCommand)>;
  /// Publishes a text to the other gateway. Returns the id of the publication, above 0.
  using Publish = std::function<std::uint64_t(std::string text)>;

  /// `boot`: of this process. `wake` makes the pair's thread call step().
  Announcements(std::string boot, std::function<void()> wake)
      : boot_(std::move(boot)), wake_(std::move(wake)) {}

  /// Announces the command to the other gateway, then passes it to `submit` on the pair's thread. A
  /// read, and each command after release(), is passed at once. `device`: its name. Any thread.
  void add(AdmittedCommand command, const std::string& device, const Submit& submit);
  /// Submits everything that waits, and later commands, without an announcement. The field must
  /// refuse commands by now. Any thread.
  void release();
  /// Takes back the commands for these devices that are not submitted yet, and passes them to
  /// `done` on the pair's thread. Add no more for them afterwards; then none is submitted. Any
  /// thread.
  using TakenBack = std::function<void(std::vector<AdmittedCommand>)>;
  void take_back(std::vector<std::uint32_t> devices, TakenBack done);

  // The pair's thread.
  /// Answers take_back(). Announces what waits, as long as the broker has at most `window`
  /// announcements to acknowledge. After release() submits every command. A command whose
  /// announcement was refused is submitted after its deadline, so that the field answers it as
  /// expired.
  void step(std::size_t window, const Publish& publish, SteadyTime now);
  /// The broker has this publication. Submits its command; returns false if it is no announcement.
  bool delivered(std::uint64_t id);
  /// The broker refuses this publication.
  void refused(std::uint64_t id);

 private:
  /// A command, the text that announces it, and what takes it afterwards.
  struct Waiting {
    AdmittedCommand command;
    std::string text;
    Submit submit;
    std::uint64_t publication = 0;  ///< on its way to the broker; 0: not published yet, or refused
    bool is_refused = false;
  };
  struct Request {
    std::vector<std::uint32_t> devices;
    TakenBack done;
  };
  std::list<Waiting>::iterator published(std::uint64_t id);

  const std::string boot_;
  const std::function<void()> wake_;
  std::list<Waiting> waiting_;  ///< in order of arrival

  std::mutex mutex_;
  std::list<Waiting> added_;       ///< under mutex_
  std::vector<Request> requests_;  ///< under mutex_
  bool released_ = false;          ///< under mutex_
};

}  // namespace fxagent
