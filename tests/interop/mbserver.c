/* A libmodbus server in front of whatever answers on standard input and output, one line a question.
 *
 *   mbserver tcp             listens on a free port of 127.0.0.1
 *   mbserver rtu DEVICE      serves a serial line, 115200 baud, 8N1
 *
 * First line out: "ready PORT". Then "R address count" and "W address value..." out; in comes "0 value..." ,
 * "E code" (a Modbus exception) or "N" (no answer at all). The end of standard input ends it.
 */
#include <errno.h>
#include <modbus.h>
#include <netinet/in.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/select.h>
#include <sys/socket.h>
#include <unistd.h>

#define REGISTERS 400
#define LINE 4096

/* 1: the descriptor is readable; 0: standard input has ended. */
static int wait_for(int descriptor)
{
    for (;;) {
        fd_set set;
        FD_ZERO(&set);
        FD_SET(STDIN_FILENO, &set);
        FD_SET(descriptor, &set);
        if (select(descriptor + 1, &set, NULL, NULL, NULL) < 0) {
            if (errno == EINTR) continue;
            return 0;
        }
        if (FD_ISSET(descriptor, &set)) return 1;
        if (FD_ISSET(STDIN_FILENO, &set)) return 0;
    }
}

static char *ask(char *line)
{
    fputs(line, stdout);
    fflush(stdout);
    if (!fgets(line, LINE, stdin)) exit(0);
    return line;
}

static void serve(modbus_t *context, modbus_mapping_t *map, uint8_t *query, int length)
{
    char line[LINE];
    int offset = modbus_get_header_length(context);
    int function = query[offset];
    int address = (query[offset + 1] << 8) + query[offset + 2];
    int count = (query[offset + 3] << 8) + query[offset + 4];
    int used = 0, n;

    if (function == 0x03 && count >= 1 && count <= 125 && address + count <= REGISTERS) {
        snprintf(line, sizeof line, "R %d %d\n", address, count);
    } else if (function == 0x06 && address < REGISTERS) {
        snprintf(line, sizeof line, "W %d %d\n", address, count);
    } else if (function == 0x10 && count >= 1 && count <= 123 && address + count <= REGISTERS) {
        used = snprintf(line, sizeof line, "W %d", address);
        for (n = 0; n < count; n++) {
            uint8_t *word = query + offset + 6 + 2 * n;
            used += snprintf(line + used, sizeof line - used, " %d", (word[0] << 8) + word[1]);
        }
        snprintf(line + used, sizeof line - used, "\n");
    } else {
        modbus_reply(context, query, length, map); /* libmodbus' own exceptions */
        return;
    }
    char *word = strtok(ask(line), " \n");
    if (!word || word[0] == 'N') return;
    if (word[0] == 'E') {
        word = strtok(NULL, " \n");
        modbus_reply_exception(context, query, word ? atoi(word) : 4);
        return;
    }
    for (n = 0; function == 0x03 && n < count; n++) {
        word = strtok(NULL, " \n");
        map->tab_registers[address + n] = word ? (uint16_t)atoi(word) : 0;
    }
    modbus_reply(context, query, length, map);
}

/* Answers until the connection ends; 0 when standard input has ended. */
static int converse(modbus_t *context, modbus_mapping_t *map)
{
    uint8_t query[MODBUS_TCP_MAX_ADU_LENGTH];
    for (;;) {
        if (!wait_for(modbus_get_socket(context))) return 0;
        int length = modbus_receive(context, query);
        if (length > 0) serve(context, map, query, length);
        else if (length < 0) return 1;
    }
}

int main(int count, char **argument)
{
    modbus_mapping_t *map = modbus_mapping_new(0, 0, REGISTERS, 0);
    modbus_t *context = NULL;
    setvbuf(stdin, NULL, _IONBF, 0);
    if (count == 3 && !strcmp(argument[1], "rtu")) {
        context = modbus_new_rtu(argument[2], 115200, 'N', 8, 1);
        if (!context || modbus_set_slave(context, 1) || modbus_connect(context)) return 1;
        printf("ready 0\n");
        fflush(stdout);
        while (converse(context, map)) {
        }
    } else if (count == 2 && !strcmp(argument[1], "tcp")) {
        struct sockaddr_in bound;
        socklen_t size = sizeof bound;
        context = modbus_new_tcp("127.0.0.1", 0);
        int listening = context ? modbus_tcp_listen(context, 1) : -1;
        if (listening < 0 || getsockname(listening, (struct sockaddr *)&bound, &size)) return 1;
        printf("ready %d\n", ntohs(bound.sin_port));
        fflush(stdout);
        while (wait_for(listening)) {
            if (modbus_tcp_accept(context, &listening) < 0) continue;
            int more = converse(context, map);
            modbus_close(context);
            if (!more) break;
        }
        close(listening);
    } else {
        return 2;
    }
    modbus_mapping_free(map);
    modbus_free(context);
    return 0;
}
