#include "protocol/mc/dialect.h"

#include <algorithm>

#include "protocol/encoding.h"

namespace fxagent::mc {
namespace {

// The bus accepts answers of up to 4096 bytes. Words carry the same bits in fewer bytes.
constexpr std::uint32_t kSerialBits = 3584;

}  // namespace

Result<Dialect> dialect_from(Frame frame, const Options& options) {
  Dialect dialect;
  dialect.frame = frame;
  if (const auto* name = option<std::string>(options, "model"); name && *name != kAutoModel) {
    const auto of_model = with_model(dialect, *name);
    if (!of_model)
      return refuse("model '" + *name + "' has no frames of this protocol" +
                    (with_model({Frame::e1}, *name) ? ": use mc-1e" : ""));
    dialect = *of_model;
  }
  Route& route = dialect.route;
  take_option(route.network, options, "network", 0, 0xFF);
  take_option(route.pc, options, "pc", 0, 0xFF);
  take_option(route.module_io, options, "module_io", 0, 0xFFFF);
  take_option(route.module_station, options, "module_station", 0, 0xFF);
  take_option(dialect.station, options, "station", 0, 31);
  take_option(dialect.format, options, "format", 1, frame == Frame::c4 ? 5 : 4);
  take_option(dialect.max_block_bytes, options, "max_block_bytes", 2, dialect.max_block_bytes);
  std::uint32_t timer = dialect.timer * kTimerStepMs;
  take_option(timer, options, "monitoring_timer_ms", kTimerStepMs, 60000);
  if (timer % kTimerStepMs != 0) return refuse("monitoring_timer_ms must be a multiple of 250");
  dialect.timer = timer / kTimerStepMs;
  take_option(dialect.sum_check, options, "sum_check");
  if (const auto* word = option<std::string>(options, "code"))
    dialect.code = *word == "ascii" ? Code::ascii : Code::binary;
  return dialect;
}

std::optional<Dialect> with_model(Dialect dialect, std::string_view model) {
  const auto known = model_named(model);
  if (!known) return std::nullopt;
  const Series series = series_of(*known);
  const bool has_frame = dialect.frame == Frame::e1 ? series == Series::fx3 || series == Series::q_l
                                                    : is_fx(*known) == (dialect.frame == Frame::c1);
  if (!has_frame) return std::nullopt;
  dialect.model = *known;
  return dialect;
}

bool has_long_codes(const Dialect& dialect, std::uint8_t way) {
  return dialect.series() == Series::iq_r && (way & kPlainCodes) == 0;
}

Limits limits_of(const Dialect& dialect, bool long_codes) {
  const Series series = dialect.series();
  const bool is_ascii = dialect.code == Code::ascii;
  const bool is_wide = series == Series::q_l || series == Series::iq_r;
  const bool has_blocks = series == Series::iq_f || series == Series::iq_r;
  Limits limits{.words = is_ascii && !is_wide ? 480U : 960U,
                .bits = (is_ascii ? 1792U : 3584U) * (is_wide ? 2U : 1U),
                .random = 192,
                .random_cost = 1920,
                .random_bits = 188,
                .blocks = has_blocks ? 120U : 0U};
  if (long_codes) {
    limits.random /= 2;
    limits.random_cost /= 2;
    limits.random_bits /= 2;
    limits.blocks /= 2;
  }
  if (is_serial(dialect.frame)) limits.bits = std::min(limits.bits, kSerialBits);
  return limits;
}

bool has_doubtful_digits(const Dialect& dialect, Space space) {
  return dialect.code == Code::ascii && ascii_base_of(dialect.model, space) == 8;
}

bool is_contact(Space space) {
  // Letters of other kinds that end with S or C have one letter.
  const std::string_view letters = kind_of(space).letters;
  return letters.size() > 1 && (letters.ends_with('S') || letters.ends_with('C'));
}

bool is_words(const Span& span, std::uint32_t align) {
  if (width_of(span.space) != 1) return true;
  return !is_contact(static_cast<Space>(span.space)) && span.first_bit % align == 0 &&
         span.bits % 16 == 0;
}

Result<std::uint32_t> item_bits(const Scatter& scatter, std::uint32_t bits, std::uint32_t words,
                                std::uint32_t align) {
  std::uint64_t total = 0;
  bool all_bits = !scatter.parts.empty();
  bool all_words = all_bits;
  for (const auto& [span, image, way] : scatter.parts) {
    const std::uint32_t width = span.space < kSpaces ? width_of(span.space) : 0;
    total += span.bits;
    all_bits = all_bits && width == 1;
    all_words = all_words && (width == 1 || width == 16) && is_words(span, align);
  }
  if (all_bits && total <= bits) return 1U;
  if (all_words && total <= std::uint64_t{words} * 16) return 16U;
  return fail(ErrorCode::unsupported, "no frame carries these writes together");
}

std::vector<ReadWay> read_ways(const Dialect& dialect, std::uint16_t space_id) {
  std::vector<ReadWay> ways;
  if (space_id >= kSpaces) return ways;
  const auto space = static_cast<Space>(space_id);
  const auto numbers = numbers_of(dialect.model, space);
  const bool has_name =
      dialect.code == Code::binary || has_long_codes(dialect, 0) || !kind_of(space).ascii.empty();
  if (numbers.empty() || !has_name) return ways;
  const std::uint32_t bits = kind_of(space).bits;
  const Span run = span_of(space, numbers.front());
  const Limits limits = limits_of(dialect, has_long_codes(dialect, 0));
  const auto add = [&](std::uint8_t id, std::uint32_t align, std::uint32_t unit,
                       std::uint32_t points, std::uint8_t gather = 0) {
    if (run.bits < unit) return;
    // Bits may begin at any device with a name, words only at the first one.
    const std::uint32_t end = !has_doubtful_digits(dialect, space) ? run.end_bit()
                              : unit == 1                          ? kCertain
                                                                   : kCertainWords;
    const std::uint32_t most = std::min(points * unit, dialect.max_block_bytes * 8);
    ways.push_back({.way = id,
                    .end_bit = end,
                    .align_bits = align,
                    .unit_bits = unit,
                    .max_bits = std::max(most / unit * unit, unit),
                    .gather = gather});
  };
  if (bits == 32) {
    add(kDwordWay, 32, 32, limits.random);
    add(kRandomWay, 32, 32, 1, kRandomRead);
    return ways;
  }
  // Bits come first because they never extend past the last device. If both ways cost the same,
  // they are safer: the PLC's parameters may define fewer devices than its series allows.
  if (bits == 1) add(kBitWay, 1, 1, limits.bits);
  if (is_contact(space)) return ways;
  add(kWordWay, bits, 16, limits.words);
  add(kRandomWay, bits, 16, 2, kRandomRead);
  if (limits.blocks != 0) add(kBlockWay, bits, 16, limits.words, kBlockRead);
  return ways;
}

std::vector<GatherCommand> gathers(const Dialect& dialect) {
  const Limits limits = limits_of(dialect, has_long_codes(dialect, 0));
  const std::uint32_t block = std::max<std::uint32_t>(dialect.max_block_bytes * 8, 32);
  std::vector<GatherCommand> commands{{kRandomRead, limits.random, block}};
  if (limits.blocks != 0)
    commands.push_back({kBlockRead, limits.blocks, std::min(limits.words * 16, block)});
  return commands;
}

Result<ReadWay> way_of(const Dialect& dialect, const Read& read) {
  return way_for(
      read_ways(dialect, read.span.space), read.way, read.span,
      [&] { return device_name(dialect.model, read.span); }, "read in this way");
}

std::uint32_t max_write_bits(const Dialect& dialect, std::uint16_t space_id) {
  if (space_id >= kSpaces) return 0;
  const std::uint32_t bits = width_of(space_id);
  const Limits limits = limits_of(dialect, has_long_codes(dialect, 0));
  // For bits, as many whole bytes as fit: a remainder shorter than a word must fit, too.
  const std::uint32_t unit = std::max<std::uint32_t>(bits, 8);
  const std::uint32_t most = bits == 1    ? limits.bits
                             : bits == 16 ? limits.words * bits
                                          : limits.random_cost / kDwordCost * bits;
  return std::max(std::min(most, dialect.max_block_bytes * 8) / unit * unit, unit);
}

}  // namespace fxagent::mc
