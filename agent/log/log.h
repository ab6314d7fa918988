// One event a line on stderr: `ts level event key=value …`, or a JSON object. Any thread.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <initializer_list>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace fxagent::log {

enum class Level : std::uint8_t { debug, info, warn, error };
/// text: `ts level event key=value`. json: an object with `ts`, `level`, `event` and, in `fields`,
/// the values as strings.
enum class Format : std::uint8_t { text, json };

/// "error", "warn", "info", "debug"; "text", "json".
std::optional<Level> level_from(std::string_view word);
std::optional<Format> format_from(std::string_view word);

/// A key and its value. In text, values with blanks or quotes are quoted, control characters and
/// what is not UTF-8 are escaped byte by byte; in JSON what is not UTF-8 is U+FFFD. Of more than
/// 1,024 bytes only those are written.
using Field = std::pair<std::string_view, std::string>;
using Fields = std::vector<Field>;

/// Of a text that comes from others, so much is logged.
inline constexpr std::size_t kMostForeignBytes = 128;

/// The beginning of a text that comes from others, whole characters of at most 128 bytes, and
/// behind it how long it is where that is more. The field of a line escapes it.
std::string excerpt(std::string_view foreign);

/// Sets what is written: `info` and above at first; and how: as text at first.
void set_level(Level level);
void set_format(Format format);

/// The text after time and level: `event key=value key="value with blanks"`.
std::string format_line(std::string_view event, std::initializer_list<Field> fields);
/// A whole line of this moment in the format that was set, without its end. For who cannot wait for
/// the log.
std::string line(Level level, std::string_view event, std::initializer_list<Field> fields);

/// While it lives, lines go to stderr through a thread of their own and nobody waits for a reader;
/// of equal lines five are written in 10 s, and the rest is counted: `repeated count=… line="…"`;
/// lines that find no room are counted too: `log_lines_dropped count=…`. Where stderr is the
/// journal of systemd each line begins with its priority, `<3>` for error. Its end, and a
/// std::terminate, write what waits, for at most a second. One at a time. Throws std::system_error
/// where there is no thread; without one each line is written by who logs it.
class InBackground final {
 public:
  InBackground();
  ~InBackground();
  InBackground(const InBackground&) = delete;
  InBackground& operator=(const InBackground&) = delete;
};

void debug(std::string_view event, std::initializer_list<Field> fields = {});
void info(std::string_view event, std::initializer_list<Field> fields = {});
void warn(std::string_view event, std::initializer_list<Field> fields = {});
void error(std::string_view event, std::initializer_list<Field> fields = {});

/// A text for who has started the program by hand: as it is; in JSON the field `note` of `event`.
void say(Level level, std::string_view event, std::string_view text);

/// A line of level `trace` with the time `at`, written whatever the level is. `make` returns its
/// body(); it is called on the log's thread, when the line's turn comes, so that whoever traces
/// does not wait for it. Lines of about `bytes` bytes that find no room are dropped and counted;
/// they leave half of the room to all others. Equal ones are all written.
void trace(std::chrono::system_clock::time_point at, std::size_t bytes,
           std::function<std::string()> make);
/// Event and fields in the format that was set, without the limit of 1,024 bytes.
std::string body(std::string_view event, const Fields& fields);

}  // namespace fxagent::log
