// Services of some protocols for the PLC itself, besides its memory: query the model, start and
// stop. A protocol without them (Modbus) has no such object. This interface makes requests and
// interprets answers; codec.h has the frames.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "protocol/codec.h"

namespace fxagent {

/// Special devices that show the state of a model's CPU, as the manual names them. Empty: none.
struct SpecialDevices {
  enum class Clock : std::uint8_t {
    none,
    from_second,  ///< six words: second, minute, hour, day, month, year
    from_year,    ///< six words: year, month, day, hour, minute, second
    bcd,          ///< three words of two BCD bytes: year and month, day and hour, minute and second
  };

  std::string_view battery_low;  ///< a bit, on if the battery is low
  std::string_view has_error;    ///< a bit, on while there is an error
  std::string_view error;        ///< a word: the error code; on an FX the number of the error's M
  Clock clock = Clock::none;
  std::string_view clock_copied;  ///< a bit; the clock's words are valid while it is on
  std::string_view clock_at;      ///< the first word
};

/// Returns those of an FX, up to the FX3. Sources: JY992D48301 (FX, FX0N, FX2N) and JY997D16601
/// (FX3), the tables of special devices.
SpecialDevices special_devices_of_fx();
/// Returns the number of words of the clock.
std::uint32_t clock_words(SpecialDevices::Clock form);
/// Returns the clock as "2026-11-27 01:48:15" from the image of its words, low byte first. A year
/// of two digits is one from 1980 to 2079. nullopt if it is no date and time, or too short.
std::optional<std::string> clock_text(SpecialDevices::Clock form, ByteView image);

/// Returned by Codec::plc() and valid as long as that codec. The codec can encode every request
/// made here, except perhaps run_request(). Sources: JY992D69901 rev. E, chapter 8 (PC, RR, RS) for
/// the FX computer link; captures for the programming port. See protocol/README.md for both.
class PlcServices {
 public:
  virtual ~PlcServices() = default;

  // Model.

  /// Returns the configured or identified model; empty while it is unknown.
  virtual std::string model() const = 0;
  /// Returns the reads that identify the model, at least one, to be sent in this sequence.
  virtual std::vector<Request> identify() const { return {Control{Control::Kind::identify}}; }
  /// Returns the model from the answers of identify(): one image for each request, empty if it was
  /// refused. nullopt if the answers do not identify a model.
  virtual std::optional<std::string> model_from(const std::vector<Bytes>& images) const = 0;
  /// Returns a codec of the same protocol and options for `model`, which the device has reported.
  /// Returns nullptr for an unknown model, but never for a name that model_from() returned or
  /// ProtocolInfo::models contains.
  virtual std::shared_ptr<const Codec> with_model(std::string_view model) const = 0;

  // State of the CPU.

  /// Returns where the model shows battery, errors and clock. Nothing is known of an unknown model.
  virtual SpecialDevices special_devices() const = 0;

  // RUN and STOP.

  /// Returns the read of the run state (M8000 of an FX).
  virtual Request run_state() const = 0;
  /// Returns true if the answer of run_state() shows that the PLC runs: by its first bit, if that
  /// is M8000. nullopt if the image is too short.
  virtual std::optional<bool> run_state_from(ByteView image) const {
    return image.empty() ? std::nullopt : std::optional((image[0] & 1) != 0);
  }
  /// Returns the request that starts (true) or stops (false) the PLC. If this protocol cannot
  /// switch the model, encode() fails with unsupported. A refused request is never repeated: see
  /// Codec::meaning_of().
  virtual Request run_request(bool run) const {
    return Control{run ? Control::Kind::run : Control::Kind::stop};
  }
  /// Returns a hint for people after a failed run or stop: the switch position that is needed.
  virtual std::string run_hint() const = 0;
};

/// Returns the model of `codec`; empty while it is unknown, or if its protocol has no models.
inline std::string model_of(const Codec& codec) {
  const PlcServices* plc = codec.plc();
  return plc == nullptr ? std::string() : plc->model();
}

/// True if the model is still unknown and the device can be asked for it.
inline bool must_ask_model(const Codec& codec) {
  const PlcServices* plc = codec.plc();
  return plc != nullptr && plc->model().empty();
}

}  // namespace fxagent
