#include "text.hpp"

#include <charconv>
#include <limits>
#include <locale>
#include <sstream>
#include <string>

namespace clew::io {

namespace {

bool equal_ignoring_case(std::string_view token, std::string_view lower) {
    if (token.size() != lower.size()) return false;
    for (std::size_t i = 0; i < token.size(); ++i) {
        if ((token[i] | 0x20) != lower[i]) return false;
    }
    return true;
}

bool parse_special(std::string_view token, bool negative, double& value) {
    if (equal_ignoring_case(token, "nan") ||
        (token.size() > 4 && equal_ignoring_case(token.substr(0, 4), "nan(") && token.back() == ')')) {
        value = std::numeric_limits<double>::quiet_NaN();
        return true;
    }
    if (equal_ignoring_case(token, "inf") || equal_ignoring_case(token, "infinity")) {
        value = negative ? -std::numeric_limits<double>::infinity() : std::numeric_limits<double>::infinity();
        return true;
    }
    return false;
}

// Correctly rounded, for the few numbers whose digits do not fit the short way below.
bool parse_slowly(std::string_view token, double& value) {
#if defined(__cpp_lib_to_chars)
    const auto result = std::from_chars(token.data(), token.data() + token.size(), value);
    if (result.ec == std::errc::result_out_of_range) {
        // Too small is zero; too large is infinite, as strtod has it.
        const std::size_t e = token.find_first_of("eE");
        const bool small = e != std::string_view::npos && e + 1 < token.size() && token[e + 1] == '-';
        value = small ? 0.0 : std::numeric_limits<double>::infinity();
        return result.ptr == token.data() + token.size();
    }
    return result.ec == std::errc() && result.ptr == token.data() + token.size();
#else
    std::istringstream stream{std::string(token)};
    stream.imbue(std::locale::classic());
    stream >> value;
    return !stream.fail() && stream.eof();
#endif
}

constexpr double kPowers[] = {1e0,  1e1,  1e2,  1e3,  1e4,  1e5,  1e6,  1e7,  1e8,  1e9,  1e10, 1e11,
                              1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18, 1e19, 1e20, 1e21, 1e22};

}  // namespace

// Clinger's fast path (PLDI 1990): digits below 2^53 times or over a power of ten up to 22 round exactly once.
bool parse_double(std::string_view token, double& value) {
    if (token.empty()) return false;
    bool negative = false;
    if (token[0] == '-' || token[0] == '+') {
        negative = token[0] == '-';
        token.remove_prefix(1);
        if (token.empty()) return false;
    }
    const char* at = token.data();
    const char* end = at + token.size();
    std::uint64_t digits = 0;
    int count = 0, exponent = 0;
    bool any = false;
    for (; at != end && *at >= '0' && *at <= '9'; ++at) {
        any = true;
        if (digits != 0 || *at != '0') ++count;
        if (count <= 18) digits = digits * 10 + static_cast<unsigned>(*at - '0');
    }
    if (at != end && *at == '.') {
        for (++at; at != end && *at >= '0' && *at <= '9'; ++at) {
            any = true;
            if (digits != 0 || *at != '0') ++count;
            if (count <= 18) {
                digits = digits * 10 + static_cast<unsigned>(*at - '0');
                --exponent;
            }
        }
    }
    if (!any) return parse_special(token, negative, value);
    if (at != end) {
        if (*at != 'e' && *at != 'E') return false;
        ++at;
        bool down = false;
        if (at != end && (*at == '-' || *at == '+')) down = *at++ == '-';
        if (at == end) return false;
        int power = 0;
        for (; at != end && *at >= '0' && *at <= '9'; ++at) {
            if (power < 100000) power = power * 10 + (*at - '0');
        }
        if (at != end) return false;
        exponent += down ? -power : power;
    }
    if (digits == 0 && count == 0) {
        value = 0.0;
    } else if (count <= 18 && digits < (std::uint64_t{1} << 53) && exponent >= -22 && exponent <= 22) {
        const double whole = static_cast<double>(digits);
        value = exponent < 0 ? whole / kPowers[-exponent] : whole * kPowers[exponent];
    } else if (!parse_slowly(token, value)) {
        return false;
    }
    if (negative) value = -value;
    return true;
}

bool parse_int(std::string_view token, std::int64_t& value) {
    if (!token.empty() && token[0] == '+') token.remove_prefix(1);
    const auto result = std::from_chars(token.data(), token.data() + token.size(), value);
    return !token.empty() && result.ec == std::errc() && result.ptr == token.data() + token.size();
}

bool is_word(std::string_view token) {
    if (token.empty() || token.size() > 40) return false;
    for (const char c : token) {
        const bool good = (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') ||
                          c == '_' || c == ':' || c == '-' || c == '.';
        if (!good) return false;
    }
    return true;
}

}  // namespace clew::io
