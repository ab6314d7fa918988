// A broker that the fleet starts and kills: a child process, with its memory and CPU time from
// /proc.
#pragma once

#include <sys/types.h>

#include <string>

namespace fxfleet {

class BrokerProcess final {
 public:
  /// `command` is for sh; its last program becomes the process itself (exec). Its output goes to
  /// `log`; empty: to our stderr.
  BrokerProcess(std::string command, std::string log)
      : command_(std::move(command)), log_(std::move(log)) {}
  BrokerProcess(const BrokerProcess&) = delete;
  BrokerProcess& operator=(const BrokerProcess&) = delete;
  ~BrokerProcess() { kill(); }

  /// Throws std::system_error if no process can be made.
  void start();
  /// SIGKILL, and waits for the end.
  void kill();
  /// True if it ended on its own. Its status is then collected.
  bool has_ended();

  /// VmRSS in KiB; 0 if it does not run.
  long memory_kib() const;
  /// CPU time so far in s, user and system; 0 if it does not run.
  double cpu_s() const;

 private:
  const std::string command_;
  const std::string log_;
  pid_t pid_ = 0;
};

/// CPU time of this process so far, in s.
double own_cpu_s();

}  // namespace fxfleet
