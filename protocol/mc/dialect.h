// Settings of a PLC and its port that determine the frames, and the differences between the series:
// limits of one request of 3E, 4E, 3C and 4C, and the ways to read memory. Sources: SH-080008,
// JY997D56001; limits of random access as measured on PLCs: protocol/README.md.
#pragma once

#include <cstdint>
#include <optional>
#include <string_view>
#include <vector>

#include "protocol/codec.h"
#include "protocol/mc/device.h"
#include "protocol/options.h"

namespace fxagent::mc {

/// The "communication data code" of a port.
enum class Code : std::uint8_t { binary, ascii };

/// 1E is in one_e.h. 1C is the frame of the computer link of an FX (fx/computer_link.h).
enum class Frame : std::uint8_t { e1, e3, e4, c1, c3, c4 };
constexpr bool is_serial(Frame frame) { return frame >= Frame::c1; }

/// Access route to the addressed station. The defaults address the connected station.
struct Route {
  std::uint8_t network = 0;
  std::uint8_t pc = 0xFF;
  std::uint16_t module_io = 0x03FF;
  std::uint8_t module_station = 0;
  friend bool operator==(const Route&, const Route&) = default;
};

/// Model of a PLC, and the settings of its port.
struct Dialect {
  Frame frame = Frame::e3;
  Model model = Model::unknown;
  Code code = Code::binary;  ///< Mc derives that of 3C and 4C from the format
  Route route{};             ///< that of a 3C frame ends with the PC number
  std::uint32_t timer = 16;  ///< 1E, 3E and 4E: monitoring timer in kTimerStepMs, 1 or more
  std::uint8_t station = 0;  ///< 1C, 3C and 4C, as the next two
  std::uint32_t format = 1;
  bool sum_check = true;
  std::uint32_t max_block_bytes = 1920;  ///< of device memory in one frame; 960 words
  std::uint32_t wait_tens = 0;   ///< 1C: 0 to 15, times 10 ms: wait of the PLC before it answers
  bool acknowledge_data = true;  ///< 1C: answer data with ACK, as the manual requires

  Series series() const { return series_of(model); }
};
/// Unit of Dialect::timer.
inline constexpr std::uint32_t kTimerStepMs = 250;

/// Returns a dialect of 1E, 3E, 4E, 3C or 4C from the config's options; the others keep their
/// defaults. Error: bad_request if `monitoring_timer_ms` is not a multiple of 250, or if the model
/// has no such frame.
Result<Dialect> dialect_from(Frame frame, const Options& options);
/// Returns `dialect` for another model. nullopt: no such model has this frame.
std::optional<Dialect> with_model(Dialect dialect, std::string_view model);

// Read::way.
inline constexpr std::uint8_t kBitWay = 0;     ///< 0401 by bits
inline constexpr std::uint8_t kWordWay = 1;    ///< 0401 by words
inline constexpr std::uint8_t kDwordWay = 2;   ///< 0403 by double words, which 32-bit devices need
inline constexpr std::uint8_t kRandomWay = 3;  ///< words and double words of 0403, in a Gather
inline constexpr std::uint8_t kBlockWay = 4;   ///< blocks of 0406, in a Gather
// GatherCommand::gather.
inline constexpr std::uint8_t kRandomRead = 1;  ///< 0403
inline constexpr std::uint8_t kBlockRead = 2;   ///< 0406
/// Added to `way` of a Write or Force after an iQ-R has refused its own device codes: selects those
/// of Q and L.
inline constexpr std::uint8_t kPlainCodes = 0x80;
/// True if requests by this way have the 2-byte codes and 4-byte numbers of iQ-R.
bool has_long_codes(const Dialect& dialect, std::uint8_t way);

/// Cost of a word and of a double word in a 1402 (SH-080008).
inline constexpr std::uint32_t kWordCost = 12;
inline constexpr std::uint32_t kDwordCost = 14;
/// Limits of one request.
struct Limits {
  std::uint32_t words = 0;        ///< 0401 and 1401, also for words of bit devices
  std::uint32_t bits = 0;         ///< 0401 and 1401
  std::uint32_t random = 0;       ///< words and double words of 0403
  std::uint32_t random_cost = 0;  ///< 1402: sum of kWordCost and kDwordCost
  std::uint32_t random_bits = 0;  ///< 1402
  std::uint32_t blocks = 0;       ///< 0406; 0: the PLC lacks it or may lack it
};
Limits limits_of(const Dialect& dialect, bool long_codes);

/// Returns the way of a read. Errors: bad_request if the read exceeds the limits of that way;
/// unsupported if this model has no such way.
Result<ReadWay> way_of(const Dialect& dialect, const Read& read);

/// True if the digits of numbers above 7 are not known: X and Y of an FX5 in ASCII code.
bool has_doubtful_digits(const Dialect& dialect, Space space);
/// The number of such devices whose name is certain, and the number that one word from the first of
/// them covers.
inline constexpr std::uint32_t kCertain = 8;
inline constexpr std::uint32_t kCertainWords = 16;

/// True for contacts and coils of timers and counters, which are reached only bit by bit.
bool is_contact(Space space);

/// True if words can carry all of the span: whole devices, or of a bit device whole words from a
/// multiple of `align` on, except contacts and coils.
bool is_words(const Span& span, std::uint32_t align);
/// Returns the bits of one item of a frame that carries all parts: 1 or 16. A frame has room for
/// `bits` bits or `words` words; no word is half of a 32-bit device. Error: unsupported if no frame
/// can carry them.
Result<std::uint32_t> item_bits(const Scatter& scatter, std::uint32_t bits, std::uint32_t words,
                                std::uint32_t align);

/// Implement AddressSpace::read_ways(), gathers() and max_write_bits().
std::vector<ReadWay> read_ways(const Dialect& dialect, std::uint16_t space);
std::vector<GatherCommand> gathers(const Dialect& dialect);
std::uint32_t max_write_bits(const Dialect& dialect, std::uint16_t space);

}  // namespace fxagent::mc
