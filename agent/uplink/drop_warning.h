// Logs the loss of samples, with the limit that was reached and the remedy: once for each limit,
// then once a day while the loss lasts. Also logs its end. Uplink thread. Time is an argument.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>

#include "agent/steady_time.h"
#include "agent/store/guarded_store.h"
#include "agent/uplink/samples/sample_spool.h"
#include "agent/uplink/session/session.h"

namespace fxagent {

class DropWarning final {
 public:
  /// All references outlive the object. `store` is that of `waiting`; null: none.
  DropWarning(const WaitingSamples& waiting, const GuardedStore* store, const Session& session)
      : waiting_(waiting), store_(store), session_(session) {}

  /// Logs what is due. Call in each step, after the spool's work. The loss has ended if the session
  /// is connected and no sample was lost for ten minutes.
  void keep(SteadyTime now);

 private:
  struct Loss {
    std::uint64_t before = 0;  ///< samples lost before it
    SteadyTime last{};
    std::map<std::string, SteadyTime> warned{};  ///< by reason
  };

  void warn(Loss& loss, SteadyTime now) const;
  std::string broker(SteadyTime now) const;

  const WaitingSamples& waiting_;
  const GuardedStore* const store_;
  const Session& session_;
  std::uint64_t total_ = 0;  ///< samples lost until the last keep()
  std::optional<Loss> loss_;
};

}  // namespace fxagent
