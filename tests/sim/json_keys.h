// Reads and range-checks keys of the configuration and of faults. Errors name the key.
#pragma once

#include <chrono>
#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>
#include <vector>

namespace fxsim {

using Keys = std::vector<std::string_view>;

// All throw ConfigError with a text that begins with `where`. A missing key yields `fallback`.
[[noreturn]] void fail(const std::string& where, const std::string& what);
void expect_keys(const nlohmann::json& object, const Keys& known, const std::string& where);
std::int64_t number(const nlohmann::json& object, const char* key, std::int64_t fallback,
                    std::int64_t least, std::int64_t most, const std::string& where);
std::chrono::milliseconds duration(const nlohmann::json& object, const char* key, int fallback,
                                   const std::string& where);
std::string text(const nlohmann::json& object, const char* key, std::string fallback,
                 const std::string& where);
bool flag(const nlohmann::json& object, const char* key, bool fallback, const std::string& where);
/// Returns a text that must be present and not empty.
std::string required(const nlohmann::json& object, const char* key, const std::string& where);

}  // namespace fxsim
