#include "agent/text/text.h"

#include <date/date.h>
#include <utf8.h>

#include <algorithm>
#include <cstdio>
#include <locale>
#include <random>
#include <sstream>
#include <utility>

#include "agent/text/json.h"

namespace fxagent {
namespace {

constexpr std::uint32_t kForeign = 0xFFFFFFFF;  // no character

/// True for printable ASCII without quotes or backslashes, as nearly all tag names are.
bool is_plain(std::string_view text) {
  return std::all_of(text.begin(), text.end(),
                     [](char c) { return c >= 0x20 && c < 0x7F && c != '"' && c != '\\'; });
}

/// Calls `take` with each character and its bytes, and with each byte outside of any character,
/// until it returns false. Not utf8::replace_invalid(), which writes one mark for several foreign
/// bytes.
template <class Take>
void each_character(std::string_view text, Take take) {
  while (!text.empty()) {
    const std::string_view valid = text.substr(0, utf8::find_invalid(text));
    const char* const end = valid.data() + valid.size();
    for (const char* at = valid.data(); at != end;) {
      const char* const begin = at;
      const std::uint32_t character = utf8::unchecked::next(at);
      if (!take(character, std::string_view(begin, static_cast<std::size_t>(at - begin)))) return;
    }
    text.remove_prefix(valid.size());
    if (text.empty()) return;
    if (!take(kForeign, text.substr(0, 1))) return;
    text.remove_prefix(1);
  }
}

void append_byte(std::string& out, std::string_view before, char byte, std::string_view digits) {
  out += before;
  out += digits[static_cast<unsigned char>(byte) >> 4];
  out += digits[static_cast<unsigned char>(byte) & 0x0F];
}

bool stays(std::uint32_t character, Escape how) {
  if (character == kForeign) return false;
  if (how == Escape::record) return true;
  if (character < 0x20) return false;
  // U+009B starts a terminal command, like ESC [.
  if (how != Escape::json && character >= 0x7F && character < 0xA0) return false;
  return how == Escape::message || (character != '"' && character != '\\');
}

/// Appends an escape for a character that cannot stay as it is.
void append_for(std::string& out, std::uint32_t character, std::string_view bytes, Escape how) {
  constexpr std::string_view lower = "0123456789abcdef";
  constexpr std::string_view upper = "0123456789ABCDEF";
  if (character == '"' || character == '\\') {
    out += '\\';
    out += bytes;
  } else if (how != Escape::json) {
    for (const char byte : bytes)
      append_byte(out, "\\x", byte, how == Escape::message ? upper : lower);
  } else if (character == kForeign) {
    utf8::append(char32_t{0xFFFD}, out);
  } else if (character == '\n') {
    out += "\\n";
  } else {
    append_byte(out, "\\u00", bytes.front(), lower);
  }
}

}  // namespace

std::string_view take_until(std::string_view& text, char separator) {
  const std::string_view taken = text.substr(0, text.find(separator));
  text.remove_prefix(std::min(text.size(), taken.size() + 1));
  return taken;
}

std::string_view trimmed(std::string_view text) {
  constexpr std::string_view kBlank = " \t\r\n";
  const auto first = text.find_first_not_of(kBlank);
  if (first == text.npos) return {};
  return text.substr(first, text.find_last_not_of(kBlank) + 1 - first);
}

std::string_view beginning(std::string_view text, std::size_t most) {
  if (text.size() <= most) return text;
  // Bytes that are not UTF-8 may go on like this, but a character has at most four.
  const std::size_t least = most - std::min<std::size_t>(most, 3);
  while (most > least && (static_cast<unsigned char>(text[most]) & 0xC0) == 0x80) --most;
  return text.substr(0, most);
}

bool is_name(std::string_view text) {
  constexpr std::size_t kLongest = 64;
  return !text.empty() && text.size() <= kLongest && std::ranges::all_of(text, [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '_' || c == '-';
  });
}

bool is_utf8(std::string_view text) { return utf8::is_valid(text); }

std::size_t first_foreign(std::string_view text) { return utf8::find_invalid(text); }

void append_escaped(std::string& out, std::string_view text, Escape how, std::size_t most) {
  if (text.size() <= most && is_plain(text)) {
    out += text;
    return;
  }
  if (how == Escape::terminal) {
    const std::string quoted = dumped_in_ascii(nlohmann::ordered_json(text));
    out.append(quoted, 1, quoted.size() - 2);
    return;
  }
  const std::size_t before = out.size();
  std::string_view run;  // characters to append unchanged, in one go
  each_character(text, [&](std::uint32_t character, std::string_view bytes) {
    const bool room = out.size() - before + run.size() + bytes.size() <= most;
    if (room && stays(character, how)) {
      run = {run.empty() ? bytes.data() : run.data(), run.size() + bytes.size()};
      return true;
    }
    out += std::exchange(run, {});
    room ? append_for(out, character, bytes, how) : static_cast<void>(out += "...");
    return room;
  });
  out += run;
}

std::string escaped(std::string_view text, Escape how, std::size_t most) {
  std::string out;
  append_escaped(out, text, how, most);
  return out;
}

void append_json_string(std::string& out, std::string_view text) {
  out += '"';
  append_escaped(out, text, Escape::json);
  out += '"';
}

std::string ms_text(std::chrono::nanoseconds duration) {
  char text[32];
  std::snprintf(text, sizeof text, "%.1f",
                std::chrono::duration<double, std::milli>(duration).count());
  return text;
}

std::string utc_text(std::int64_t utc_ms) {
  using namespace date::literals;
  // The library has no later year, and it garbles years before 0.
  constexpr date::sys_days first = 0_y / 1 / 1;
  constexpr date::sys_days last = 32767_y / 12 / 31;
  const date::sys_time<std::chrono::milliseconds> time{std::chrono::milliseconds(utc_ms)};
  if (time < first || time >= last) return std::to_string(utc_ms) + " ms";
  return date::format(std::locale::classic(), "%FT%TZ", time);
}

std::optional<std::int64_t> utc_ms_from(std::string_view text) {
  if (text.starts_with('-')) return std::nullopt;  // the library reads years before 0
  if (text.ends_with('Z')) text.remove_suffix(1);
  // With %T the library computes with seconds that it has not read, unless all of it is there.
  constexpr std::string_view shape = "T00:00:00";
  const auto fits = [](char c, char in_shape) {
    return in_shape == '0' ? c >= '0' && c <= '9' : c == in_shape;
  };
  const bool has_seconds =
      std::ranges::equal(text.substr(std::min(text.find('T'), text.size())), shape, fits);
  for (const char* form : {has_seconds ? "%FT%T" : "%FT%R", "%F"}) {
    std::istringstream in{std::string(text)};
    in.imbue(std::locale::classic());
    date::sys_seconds time;
    // The library also accepts a text of which only the beginning matches.
    if (in >> date::parse(form, time) && in.peek() == std::istringstream::traits_type::eof())
      return std::chrono::milliseconds(time.time_since_epoch()).count();
  }
  return std::nullopt;
}

std::string random_digits() {
  char digits[9];
  std::snprintf(digits, sizeof digits, "%08x", std::random_device{}());
  return digits;
}

}  // namespace fxagent
