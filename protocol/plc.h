// What some protocols can do with the PLC itself, beside its memory: ask what it is, and start or
// stop it. A protocol without these (Modbus) has no such object at all. It makes requests and reads
// answers; the frames are codec.h's.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "protocol/codec.h"

namespace fxagent {

/// Got from Codec::plc() and valid as long as that codec. Every request made here is one that its
/// codec can encode, run_request() perhaps apart. Sources: for the FX computer link JY992D69901
/// rev. E, chapter 8 (PC, RR, RS); for the programming port captures; both in protocol/README.md.
class PlcServices {
 public:
  virtual ~PlcServices() = default;

  // Which PLC it is.

  /// The configured or identified model; empty while it is unknown.
  virtual std::string model() const = 0;
  /// The reads that tell the model, one or more, to be sent in this sequence.
  virtual std::vector<Request> identify() const = 0;
  /// The model's name from the answers of identify(), one image for each of its requests (refused
  /// ones are left empty); nullopt where they do not tell it.
  virtual std::optional<std::string> model_from(const std::vector<Bytes>& images) const = 0;
  /// The same protocol and options for a model found by asking. nullptr where there is no such
  /// model; never for a name that model_from() returned or ProtocolInfo::models has.
  virtual std::shared_ptr<const Codec> with_model(std::string_view model) const = 0;

  // RUN and STOP.

  /// The read that tells whether the PLC runs (M8000 of an FX).
  virtual Request run_state() const = 0;
  /// The answer of run_state(): true where the PLC runs; nullopt for an image too short to tell.
  virtual std::optional<bool> run_state_from(ByteView image) const = 0;
  /// The request that starts (true) or stops (false) the PLC. Where the model cannot be switched by
  /// this protocol, encode() says so (unsupported). It is never repeated after a refusal: see
  /// Codec::meaning_of().
  virtual Request run_request(bool run) const = 0;
  /// For a person whose run or stop failed: the switch position that this protocol needs.
  virtual std::string run_hint() const = 0;
};

/// The model that `codec` was made for; empty while it is unknown, or where its protocol has none.
inline std::string model_of(const Codec& codec) {
  const PlcServices* plc = codec.plc();
  return plc == nullptr ? std::string() : plc->model();
}

/// True where the device has a model that is not known yet, but that it can be asked for.
inline bool must_ask_model(const Codec& codec) {
  const PlcServices* plc = codec.plc();
  return plc != nullptr && plc->model().empty();
}

}  // namespace fxagent
