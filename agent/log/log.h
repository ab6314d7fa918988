// Writes one event per line to stderr: `ts level event key=value …`, or a JSON object. Any thread.
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
/// text: `ts level event key=value`. json: an object with `ts`, `level`, `event` and `fields`,
/// whose values are strings.
enum class Format : std::uint8_t { text, json };

/// Parse "error", "warn", "info", "debug"; "text", "json".
std::optional<Level> level_from(std::string_view word);
std::optional<Format> format_from(std::string_view word);

/// A key and its value. In text, values with blanks or quotes are quoted; control characters and
/// bytes that are not UTF-8 are escaped byte by byte. In JSON, bytes that are not UTF-8 become
/// U+FFFD. Values are cut after 1,024 bytes.
using Field = std::pair<std::string_view, std::string>;
using Fields = std::vector<Field>;

/// Returns the beginning of a text from outside: whole characters of at most 128 bytes, followed by
/// the length of the text if it is longer. The log line escapes it.
std::string excerpt(std::string_view foreign);

/// Set the lowest level that is written and the format. Initially `info` and text.
void set_level(Level level);
void set_format(Format format);

/// Returns the line without time and level: `event key=value key="value with blanks"`.
std::string format_line(std::string_view event, std::initializer_list<Field> fields);
/// Returns a whole line with the current time in the current format, without a line end. For
/// callers that cannot wait for the log.
std::string line(Level level, std::string_view event, std::initializer_list<Field> fields);

/// During its lifetime lines go to stderr through a separate thread, and callers do not wait for a
/// reader. Of equal lines, five are written per 10 s, and `repeated count=… line="…"` counts the
/// rest. Lines without room are counted too: `log_lines_dropped count=…`. If stderr is the journal
/// of systemd, each line begins with its priority, `<3>` for error. The destructor and
/// std::terminate write waiting lines, for at most 1 s. One object at a time. Throws
/// std::system_error if no thread can be started. Without an object, the calling thread writes each
/// line.
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

/// Writes a text, unchanged, for a user who started the program by hand. In JSON the text is the
/// field `note` of `event`.
void say(Level level, std::string_view event, std::string_view text);

/// Writes a line of level `trace` with the time `at`, at every level. `make` returns its body(). It
/// is called on the log's thread when the line's turn comes, so that the caller does not wait.
/// Lines of about `bytes` bytes without room are dropped and counted; traces leave half of the room
/// to other lines. Equal lines are all written.
void trace(std::chrono::system_clock::time_point at, std::size_t bytes,
           std::function<std::string()> make);
/// Returns event and fields in the current format, without the limit of 1,024 bytes.
std::string body(std::string_view event, const Fields& fields);

}  // namespace fxagent::log
